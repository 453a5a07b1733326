"""The robustness table: rows of disturbed episodes, compared with the undisturbed ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from train.evaluation.disturbances import DISTURBANCES, UNDISTURBED
from train.reporting.columns import driven_with
from train.reporting.report import Table, grouped, number, with_interval
from train.reporting.rows import Interval, Row, mean_interval, select, short_names, stratified_interval
from warehouse_env.errors import counted

SLOWER = 0.9  # share of the undisturbed goals below which a policy is slower
MORE_CONTACTS = 1.5  # times the undisturbed contacts per kilometre above which the verdict is contacts
JAMMED = 60.0  # [s], increase of the longest standing from which the verdict is jams
_FLOOR = ("layout", "robots")
_HEADER = (
    "disturbance", "policy", "goals/robot-h", "of undisturbed %", "worst floor %", "robot contacts/km",
    "shelf contacts/km", "with people/km", "longest standing s", "verdict",
)  # fmt: skip
NOTE = (
    "Goals: mean of the floors' and robot counts' means [95% interval by Student's t over episodes within them]; worst "
    "floor: where the share of the undisturbed goals is least; contacts: of all episodes together, a pair counts once; "
    "longest standing: of any robot within a metre of one place, mean over episodes. Verdict, the first that is true: "
    f"contacts: over {MORE_CONTACTS:g} times those of the undisturbed row per kilometre; jams: longest standing "
    f"{JAMMED:g} s longer or more; slower: under {100 * SLOWER:g}% of its goals; else holds. "
    "Lidar and delay disturb only what the policy sees: the path follower, the shield and right of way know each "
    "robot's own state exactly, and greedy does not look. A robot whose message is lost appears only in lidar, and the "
    "shield keeps its last announced stop. The broken robot, after 60 s in an aisle, still counts among the robots; no "
    "other robot takes its goal or avoids goals under it. Lidar sees people; the shield lets a robot drive only if it "
    "stands before anybody can reach its place, and live routes avoid people who stand."
)


@dataclass(frozen=True)
class Measured:
    """A policy under a disturbance, over all floors and robot counts."""

    goals: Interval  # per robot-hour
    by_floor: dict[tuple[object, ...], float]  # the same, by layout and robots
    robot_contacts: float  # per km
    shelf_contacts: float
    person_contacts: float
    standing: float  # [s], the longest of any robot, mean over episodes

    @property
    def contacts(self) -> float:
        """Contacts per kilometre, with robots, shelves and people."""
        return self.robot_contacts + self.shelf_contacts + self.person_contacts

    def share_of(self, usual: Measured) -> float:
        """Return the goals as a share of those of `usual`; NaN where that has none."""
        return _ratio(self.goals.mean, usual.goals.mean)

    def worst_floor(self, usual: Measured) -> tuple[float, tuple[object, ...]]:
        """Return the least share of a layout and number of robots, and which they are."""
        shares = [(_ratio(goals, usual.by_floor[floor]), floor) for floor, goals in self.by_floor.items()]
        return min(shares, key=lambda share: math.inf if math.isnan(share[0]) else share[0])


def measure(rows: Sequence[Row]) -> Measured:
    """Sum up the rows of a policy under a disturbance; at least one."""
    floors = {floor: [row["goals_per_robot_hour"] for row in group] for floor, group in grouped(rows, _FLOOR).items()}
    km, kinds = sum(row["robot_km"] for row in rows), ("robot", "shelf", "person")
    robot, shelf, person = (_ratio(sum(row.get(f"collisions_{kind}", 0.0) for row in rows), km) for kind in kinds)
    by_floor = {floor: mean_interval(goals).mean for floor, goals in floors.items()}
    standing = mean_interval(row["longest_standing_s"] for row in rows).mean
    return Measured(stratified_interval(list(floors.values())), by_floor, robot, shelf, person, standing)


def verdict(found: Measured, usual: Measured) -> str:
    """Return the verdict on a policy under a disturbance, by the rules of NOTE."""
    if found.contacts > MORE_CONTACTS * usual.contacts:
        return "contacts"
    if found.standing >= usual.standing + JAMMED:
        return "jams"
    return "holds" if found.share_of(usual) >= SLOWER else "slower"


def robust_table(rows: Sequence[Row]) -> Table:
    """Return one line for each disturbance and policy. Rows: those of the undisturbed world are among them."""
    short = short_names({str(row["policy"]) for row in rows} | {str(row["layout"]) for row in rows})
    usual = {str(row["policy"]): measure(select(rows, disturbance=UNDISTURBED, policy=row["policy"])) for row in rows}
    cells = []
    for (name, policy), group in grouped(rows, ("disturbance", "policy")).items():
        found, base = measure(group), usual[str(policy)]
        share, (layout, robots) = found.worst_floor(base)
        each = found.robot_contacts, found.shelf_contacts, found.person_contacts, found.standing
        contacts = tuple(number(figure, 2) for figure in each)
        worst = f"{number(100 * share, 2)} ({short[str(layout)]}, {robots})"
        compared = number(100 * found.share_of(base), 2), worst
        known = name != UNDISTURBED
        cells.append((
            DISTURBANCES[str(name)].summary, short[str(policy)], with_interval(found.goals),
            *(compared if known else ("", "")), *contacts, verdict(found, base) if known else "",
        ))  # fmt: skip
    return Table(
        f"Robustness ({_about(rows)})", _HEADER, tuple(cells), driven_with(select(rows, disturbance=UNDISTURBED)) + NOTE
    )


def _about(rows: Sequence[Row]) -> str:
    """Say what the rows are of."""
    short = short_names({str(row["layout"]) for row in rows})
    floors = ", ".join(f"{short[str(layout)]} with {robots}" for layout, robots in grouped(rows, _FLOOR))
    episodes = len({row["episode"] for row in rows})
    robots = f"{floors} robot{'s' * (rows[-1]['robots'] != 1)}"
    return f"{robots}; {counted(episodes, 'episode')} of {number(rows[0]['seconds'])} s each"


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0 else math.nan
