"""The tables of `warehouse tables learning`, from rows alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from train.reporting.report import Table, with_interval
from train.reporting.rows import Interval, Row, apart, is_told, mean_interval, select
from warehouse_env.config import EnvConfig

START = "start"  # the policy before its first update


class Setting(NamedTuple):
    """Traffic options under which a policy drives."""

    name: str
    switches: tuple[bool, bool, bool]  # shield, live routes, right of way

    @property
    def traffic(self) -> str:
        """The switches as a text of `read_traffic`: when right of way steps in is the policy's own affair."""
        return "own:shield={},routes={},right_of_way={}".format(*(str(one).lower() for one in self.switches))


SETTINGS = (
    Setting("none", (False, False, False)),
    Setting("live routes", (False, True, False)),
    Setting("field", (True, False, False)),
    Setting("field, live routes", (True, True, False)),
    Setting("all: right of way", (True, True, True)),
)
NOTE = (
    "Late: goals/robot-h in the second half, as a share of those of one robot alone under `greedy`. Waiting: share of "
    "time standing. Detour: driven over planned, of goals reached. Means [95% interval by Student's t]: over the means "
    "of the training seeds for what is trained, each from its own episodes, so that it covers seeds and episodes; over "
    "episodes for `greedy` and for the start, the network before its first update. Above it: late goals/robot-h over "
    "the start's under the same setting, where the interval leaves out 0."
)
MEASURES: dict[str, tuple[Callable[[Row], float | None], float]] = {  # heading -> value, factor
    "waiting %": (lambda row: row["waiting_share"], 100.0),
    "detour %": (lambda row: row["path_length_ratio"] and row["path_length_ratio"] - 1.0, 100.0),
    "near misses/km": (lambda row: row["near_misses"] / row["robot_km"], 1.0),
    "contacts/km": (lambda row: row["collisions_per_km"], 1.0),
}


def setting_of(row: Row) -> str:
    """Return the name of the setting of a row; KeyError if it is none of SETTINGS."""
    spec = EnvConfig.from_dict(row["config"]).traffic_spec
    named: dict[Any, str] = {setting.switches: setting.name for setting in SETTINGS}
    return named[spec.shield, spec.routes, spec.right_of_way]


def samples(rows: Sequence[Row], group: Sequence[str], value: Callable[[Row], float | None]) -> list[float | None]:
    """Return a mean for each policy of a group; of a single policy the values of its episodes."""
    if len(group) == 1:
        return [value(row) for row in select(rows, policy=group[0])]
    return [mean_interval(value(row) for row in select(rows, policy=policy)).mean for policy in group]


def learning_tables(rows: Sequence[Row], policies: dict[str, list[str]]) -> list[Table]:
    """Return a table for each floor and number of robots; policies: the policies (folders) of each name."""
    tables = []
    for floor in dict.fromkeys(row["layout"] for row in rows):
        own = select(rows, layout=floor)
        free = mean_interval(row["late_goals_per_robot_hour"] for row in select(own, robots=1)).mean
        for robots in sorted({row["robots"] for row in own} - {1}):
            cells = tuple(_lines(select(own, robots=robots), policies, free))
            header = ("setting", "policy", "trainings", "episodes", "late %", "above the start", *MEASURES)
            title = f"{floor}, {robots} robots (one alone: {free:.0f} late goals/h)"
            tables.append(Table(title, header, cells, NOTE))
    return tables


def _lines(rows: Sequence[Row], policies: dict[str, list[str]], free: float) -> list[tuple[str, ...]]:
    lines, to_share = [], 100.0 / free if free else math.nan
    for setting in SETTINGS:
        driven = [row for row in rows if setting_of(row) == setting.name]
        for name, group in policies.items():
            own = [row for row in driven if row["policy"] in group]
            if not own:
                continue
            late = mean_interval(samples(driven, group, _late))
            start = mean_interval(samples(driven, policies[START], _late))
            texts = [with_interval(mean_interval(samples(driven, group, value)), by) for value, by in MEASURES.values()]
            counts = str(len(group)) if len(group) > 1 else "-", str(len(own))
            above = "" if name == START else _difference(late, start)
            lines.append((setting.name, name, *counts, with_interval(late, to_share), above, *texts))
    return lines


def _late(row: Row) -> float | None:
    return float(row["late_goals_per_robot_hour"])


def _difference(ours: Interval, theirs: Interval) -> str:
    """Return the difference of two independent means with its interval, or that none can be told."""
    found = apart(ours, theirs)
    return f"{found.mean:+.1f} [{found.low:+.1f}, {found.high:+.1f}]" if is_told(found) else "not told apart"
