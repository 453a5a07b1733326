"""`warehouse tables floors`: drive policies and the rule on named floors and floors drawn at random."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from train.evaluation.episodes import EpisodesJob
from train.evaluation.rollout import Experiment, make_experiment
from train.reporting.columns import difference_of, driven_with
from train.reporting.report import Table, difference, number, with_interval
from train.reporting.rows import Row, is_significant, mean_interval, select, short_names
from train.tables.options import TableOptions
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.layouts import make_layout

LAYOUTS = ("paper46", "narrow", "single_lane")
GENERATED = "aisles:"  # how the layouts begin that are drawn at random
DRAWN = range(701, 721)  # seeds of `aisles`: nothing was trained or chosen on these floors
LARGE = {92: 256, 130: 512, 184: 1024}  # side of `blocks` [cells] -> robots: as dense as 64 on paper46
RULE = "greedy"  # right of way alone
ALONE = 25  # episodes of a single robot for each of these; all shares rest on it
SECONDS = 600.0
SEED = 26_000_000  # of the first episode, plus --seed; no training and no choice has used seeds from here on
NOTE = (
    "Late: goals/robot-h in the second half [95% interval by Student's t over episodes]. % of alone: their share of "
    "one robot's, alone on the same floor under the rule. Above the rule: mean of the paired differences, floor and "
    "seed the same. Stuck: robots without a metre of progress in the last minute. Stood: the longest that a robot "
    "stayed within a metre."
)
HEADER = (
    "floor", "robots", "policy", "late goals/h", "% of alone", "above the rule", "stuck %", "stood s", "contacts", "km",
)  # fmt: skip


@dataclass(frozen=True)
class FloorsTable(TableOptions):
    """Drive policies and the rule: 32 to 128 robots on named and 20 drawn floors, 256 to 1,024 on large ones."""

    name: ClassVar[str] = "floors"

    policy: tuple[str, ...] = ("shielded",)
    """Policies to compare with the rule: names, or folders of trained ones."""
    robots: tuple[int, ...] = (32, 64, 128)
    """Numbers of robots, except on large floors."""
    runs: int = 4
    """Episodes of each floor; one each on drawn and large floors."""
    maps: tuple[str, ...] = ()
    """Layouts to drive on, instead of all floors."""

    def run(self) -> None:
        """Drive what is missing, then write the tables."""
        rows = self.rows_of([EpisodesJob(one) for one in self.experiments()], self.page, mixed=True)
        table = floors_table(rows, self.policy)
        table.print()
        self.write("Policies on many floors", [table])

    def experiments(self) -> Iterator[Experiment]:
        """Yield what is driven: on every floor one robot alone by the rule, then the rule and every policy."""
        if not self.robots or min(self.robots) < 2:
            raise ConfigError(f"--robots {self.robots} must be numbers of at least 2")
        for place, (layout, fleets, many) in enumerate(self._floors()):
            seed = SEED + self.seed + place * layout.startswith(GENERATED)
            yield make_experiment(RULE, EnvConfig(layout, num_agents=1), ALONE * many, SECONDS, seed)
            for robots, policy in itertools.product(fleets, dict.fromkeys((RULE, *self.policy))):
                yield make_experiment(policy, EnvConfig(layout, num_agents=robots), many, SECONDS, seed)

    def _floors(self) -> Iterator[tuple[str, tuple[int, ...], int]]:
        """Yield each layout with its numbers of robots and episodes."""
        for layout in self.maps or (*LAYOUTS, *(f"{GENERATED}seed={seed}" for seed in DRAWN)):
            make_layout(layout)  # a wrong name is refused before anything drives
            yield layout, self.robots, 1 if layout.startswith(GENERATED) else self.runs
        if not self.maps:
            yield from ((f"blocks:rows={side},columns={side}", (robots,), 1) for side, robots in LARGE.items())


def _floor(row: Row) -> str:
    """Return the group of a row's floor: its name, or one for all that are drawn at random."""
    layout = str(row["layout"])
    return "drawn at random" if layout.startswith(GENERATED) else Path(layout).stem


def floors_table(rows: Sequence[Row], policies: Sequence[str]) -> Table:
    """Return a line for each group of floors, number of robots and policy, the rule first."""
    names, cells = short_names({RULE, *policies}), []
    for floor in dict.fromkeys(map(_floor, rows)):
        own = [row for row in rows if _floor(row) == floor]
        alone = mean_interval(map(_late, select(own, robots=1))).mean
        for robots in sorted({row["robots"] for row in own} - {1}):
            rule = select(own, robots=robots, policy=RULE)
            for policy in dict.fromkeys((RULE, *policies)):
                driven = rule if policy == RULE else select(own, robots=robots, policy=policy)
                cells.append((floor, str(robots), names[policy], *_line(driven, rule, alone)))
    return Table("Policies on many floors", HEADER, tuple(cells), driven_with(rows) + NOTE)


def _late(row: Row) -> float:
    return float(row["late_goals_per_robot_hour"])


def _line(rows: Sequence[Row], rule: Sequence[Row], free: float) -> tuple[str, ...]:
    late = mean_interval(map(_late, rows))
    late = late._replace(low=max(late.low, 0.0))  # goals cannot be negative; NaN stays NaN
    above = ""
    if rows and rows is not rule:
        found = difference_of(rows, rule, _late, ("layout", "seed"))
        above = difference(found) + ("" if is_significant(found) else ", may be chance")
    return (
        with_interval(late), f"{100 * late.mean / free:.0f}" if free else "", above,
        number(100 * mean_interval(row["stuck"] for row in rows).mean, 2),
        number(max((row["longest_standing_s"] for row in rows), default=0.0), 3),
        number(sum(row["collisions_robot"] + row["collisions_shelf"] for row in rows)),
        number(sum(row["robot_km"] for row in rows)),
    )  # fmt: skip
