"""The tables of `warehouse tables floors`, from rows alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from train.reporting.report import Table, difference, number, short_names, with_interval
from train.reporting.rows import Row, is_told, mean_interval, paired, select

RULE = "greedy"  # right of way alone
GENERATED = "aisles:"  # how the layouts begin that are drawn at random
NOTE = (
    "Late: goals/robot-h in the second half [95% interval by Student's t over episodes; of drawn floors each is an "
    "episode]; % of alone: their share of one robot's, alone on the same floor under the rule. Above the rule: mean of "
    "the paired differences, floor and seed the same. Stuck: share of robots without a metre of progress in the last "
    "minute; stood: the longest that any stood within a metre."
)
HEADER = (
    "floor", "robots", "policy", "late goals/h", "% of alone", "above the rule", "in %", "stuck %", "stood s",
    "contacts", "km",
)  # fmt: skip


def floor_of(row: Row) -> str:
    """Return the group of a row's floor: its name, or one for all that are drawn at random."""
    layout = str(row["layout"])
    return "drawn at random" if layout.startswith(GENERATED) else Path(layout).stem


def floors_tables(rows: Sequence[Row], policies: Sequence[str], planners: Sequence[str]) -> list[Table]:
    """Return a table of policies with routes by the first planner, and one that holds each other planner against it."""
    tables = [_policies_table(select(rows, planner=planners[0]), policies)]
    return tables + [_planners_table(rows, policies, planners[0], other) for other in planners[1:]]


def _planners_table(rows: Sequence[Row], policies: Sequence[str], planner: str, other: str) -> Table:
    """Return a line for each group of floors, number of robots and policy: goals with routes by either planner."""
    names = short_names({RULE, *policies})
    cells: list[tuple[str, ...]] = []
    for floor in dict.fromkeys(map(floor_of, rows)):
        own = [row for row in rows if floor_of(row) == floor]
        for robots in sorted({row["robots"] for row in own} - {1}):
            for policy in (RULE, *policies):
                one, two = (select(own, robots=robots, policy=policy, planner=name) for name in (planner, other))
                found = paired(one, two, _late, ("layout", "seed"))
                late = [number(mean_interval(map(_late, driven)).mean) for driven in (one, two)]
                told = "" if is_told(found) else ", not told apart"
                cells.append((floor, str(robots), names[policy], *late, difference(found) + told))
    header = ("floor", "robots", "policy", planner, other, "difference")
    note = f"Late goals/robot-h with all routes by {planner} or by {other}; floor and seed of each pair the same."
    return Table(f"Routes by {planner} and by {other}", header, tuple(cells), note)


def _policies_table(rows: Sequence[Row], policies: Sequence[str]) -> Table:
    """Return a line for each group of floors, number of robots and policy, the rule first."""
    names = short_names({RULE, *policies})
    cells: list[tuple[str, ...]] = []
    for floor in dict.fromkeys(map(floor_of, rows)):
        own = [row for row in rows if floor_of(row) == floor]
        free = mean_interval(row["late_goals_per_robot_hour"] for row in select(own, robots=1)).mean
        for robots in sorted({row["robots"] for row in own} - {1}):
            driven = select(own, robots=robots)
            rule = select(driven, policy=RULE)
            cells += [
                (floor, str(robots), names[policy], *_line(select(driven, policy=policy), rule, free))
                for policy in (RULE, *policies)
            ]
    return Table("Policies on many floors", HEADER, tuple(cells), NOTE)


def _late(row: Row) -> float:
    return float(row["late_goals_per_robot_hour"])


def _percent(part: float, whole: float, form: str) -> str:
    return format(100 * part / whole, form) if whole else ""


def _line(rows: Sequence[Row], rule: Sequence[Row], free: float) -> tuple[str, ...]:
    late = mean_interval(map(_late, rows))
    late = late._replace(low=max(late.low, 0.0))  # nobody reaches fewer than no goals; NaN stays NaN
    above, share = "", ""
    if rows and rows[0]["policy"] != RULE:
        found = paired(rows, rule, _late, ("layout", "seed"))
        above = difference(found) if is_told(found) else f"{difference(found)}, not told apart"
        share = _percent(found.mean, mean_interval(map(_late, rule)).mean, "+.1f")
    return (
        with_interval(late), _percent(late.mean, free, ".0f"), above, share,
        number(100 * mean_interval(row["stuck"] for row in rows).mean, 2),
        number(max((row["longest_standing_s"] for row in rows), default=0.0), 3),
        number(sum(row["collisions_robot"] + row["collisions_shelf"] for row in rows)),
        number(sum(row["robot_km"] for row in rows)),
    )  # fmt: skip
