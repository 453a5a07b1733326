"""The fixed set of `warehouse benchmark`: floors, fleets, seeds and tracks. A change of any is a new version.

The rows of the shipped policies are in `fixed_set.jsonl`, one an episode.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from agents import make_policy
from train.evaluation.rollout import Experiment, config_of, make_experiment
from train.reporting.columns import aspects, config_of_row
from train.reporting.report import Table, grouped, number, with_interval
from train.reporting.rows import Interval, Row, mean_interval, select, stratified_interval
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WeightsError

VERSION = 2
SHIPPED = Path(__file__).with_suffix(".jsonl")
SECONDS = 600.0  # of an episode
SEED = 50_000_000  # of the first episode of each case; nothing may be trained or chosen on seeds from here on
PLANNER = "pf_aco"
SHIELDED = "with_shield"
TRACKS = {
    SHIELDED: "with the shield, right of way and live routes",
    "routes_only": "with live routes alone: only the policy keeps robots apart",
}
NOTE = (
    "Goals per robot and hour in the second half of 600 s: the mean of the groups [95% interval by Student's t over "
    "episodes within them], then each group's. Contacts: of all episodes together. Stuck: robots without a metre of "
    "progress in the last minute. Stood: the longest that a robot stayed within a metre. Driven with: traffic, and the "
    f"time between decisions; all routes by {PLANNER}."
)


class Case(NamedTuple):
    """A floor with its robots. Cases of one group are reported together."""

    group: str
    layout: str
    robots: int
    episodes: int


CASES: tuple[Case, ...] = (
    *(Case(f"named, {n}", layout, n, 3) for n in (32, 64) for layout in ("paper46", "narrow")),
    Case("named, 128", "paper46", 128, 2),
    *(Case(f"drawn, {n}", f"aisles:seed={seed}", n, 1) for n in (32, 64) for seed in range(801, 813)),
    Case("large, 256", "blocks:rows=92,columns=92", 256, 2),
)


def options(policy: str, track: str) -> dict[str, Any]:
    """Return the fields of EnvConfig that a track sets against the policy's own.

    On `with_shield`, right of way acts when the policy asks for it, or as "assist" says. Raw actions have no right of
    way, since they follow no route.
    """
    own = config_of(policy, EnvConfig(), {})
    if track != SHIELDED:
        return {"traffic": "routes"}
    if own.action_type == "raw":
        return {"traffic": "shield"}
    return {"traffic": "own:shield=true,routes=true" if own.traffic_spec.right_of_way else "assist"}


def tracks(policy: str) -> list[str]:
    """Return the tracks that a policy can drive on. Weights trained under the shield cannot drive without it."""
    found = []
    for track in TRACKS:
        try:
            make_policy(policy, config_of(policy, EnvConfig(), options(policy, track)))
        except WeightsError:
            if track == SHIELDED:
                raise
            continue
        found.append(track)
    return found


def experiments(policy: str, cases: Sequence[Case] = CASES) -> Iterator[tuple[str, Experiment]]:
    """Yield the track and the experiment of each case; errors as of `make_experiment`."""
    for track in tracks(policy):
        chosen = options(policy, track)
        for place, case in enumerate(cases):
            base = EnvConfig(layout=case.layout, num_agents=case.robots, planner=PLANNER)
            yield track, make_experiment(policy, base, case.episodes, SECONDS, SEED + 1000 * place, chosen)


def benchmark_tables(rows: Sequence[Row], cases: Sequence[Case] = CASES) -> list[Table]:
    """Return a table for each track, the policy with the most goals first; rows: of `experiments`, with their track."""
    return [_table(track, select(rows, track=track), cases) for track in TRACKS]


def _table(track: str, rows: Sequence[Row], cases: Sequence[Case]) -> Table:
    group_of = {(case.layout, case.robots): case.group for case in cases}
    lines = []
    for (policy,), own in grouped(rows, ("policy",)).items():
        late: dict[str, list[float]] = {group: [] for group in group_of.values()}
        for row in own:
            late[group_of[row["layout"], row["robots"]]].append(row["late_goals_per_robot_hour"])
        goals = stratified_interval(list(late.values()))
        means = [mean_interval(values).mean for values in late.values()]
        lines.append((goals, (str(policy), _driven_with(own[0]), *_cells(goals, means, own))))
    lines.sort(key=lambda line: -line[0].mean)
    header = (
        "policy", "driven with", "goals/robot-h", *dict.fromkeys(group_of.values()), "contacts/km", "stuck %",
        "stood s",
    )  # fmt: skip
    return Table(f"{track}: {TRACKS[track]}", header, tuple(cells for _, cells in lines), NOTE)


def _driven_with(row: Row) -> str:
    """Name traffic and decision interval; shipped rows, which have no configuration, were driven as the track says."""
    config = config_of_row(row) or config_of(row["policy"], EnvConfig(), options(row["policy"], row["track"]))
    return ", ".join(value for name, value in aspects(config).items() if name != "planner")


def _cells(goals: Interval, means: Sequence[float], rows: Sequence[Row]) -> tuple[str, ...]:
    km = sum(row["robot_km"] for row in rows)
    contacts = sum(row["collisions_robot"] + row["collisions_shelf"] for row in rows)
    return (
        with_interval(goals), *map(number, means), number(contacts / km, 2) if km else "-",
        number(100 * mean_interval(row["stuck"] for row in rows).mean, 2),
        number(max(row["longest_standing_s"] for row in rows)),
    )  # fmt: skip
