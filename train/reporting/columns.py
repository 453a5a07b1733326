"""How rows become lines of a table: the columns with their units, groups of trainings of one recipe with intervals over
trainings and episodes, and what the policies are driven with.
"""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.reporting.rows import Interval, Row, mean_interval, short_names, t_quantile, values_of
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.traffic_spec import written_traffic

EPISODE = ("layout", "robots", "tasks", "disturbance", "seed")  # fields that identify an episode
TRAINING = "training"  # the field of a regrouped row that holds the policy; "policy" holds the group
NOTE = (
    " Groups ({}): intervals over trainings and episodes by Student's t, with the variance of two-way clusters "
    "(Cameron, Gelbach and Miller 2011) and Satterthwaite's degrees of freedom."
)
Value = Callable[[Row], float | None]
Groups = dict[str, tuple[str, ...]]
"""Name of a group -> its policies."""


def read_groups(texts: Iterable[str]) -> Groups:
    """Return the groups in texts such as "mine=runs/a,runs/b"; raises ConfigError for anything else."""
    groups = {name: tuple(filter(None, rest.split(","))) for name, _, rest in (text.partition("=") for text in texts)}
    for name, policies in groups.items():
        if not name or len(set(policies)) < max(2, len(policies)):
            raise ConfigError(f"--group {name!r} must be NAME=POLICY,POLICY with two or more different policies")
    return groups


def regrouped(rows: Sequence[Row], groups: Groups, alone: Sequence[str] = ()) -> list[Row]:
    """Return the rows of each group under its name, after those of policies that are `alone` or in no group.

    Groups without rows are left out. Raises ConfigError for a name that a policy has, and for a training without rows.
    """
    known = {str(row["policy"]) for row in rows}
    groups = {name: own for name, own in groups.items() if known.intersection(own)}
    members = {one for own in groups.values() for one in own}
    if wrong := sorted(known & groups.keys() | members - known):
        raise ConfigError(f"--group: {wrong[0]} must be a new name before =, and have rows behind it")
    kept = [row for row in rows if row["policy"] not in members or row["policy"] in alone]
    return kept + [
        {**row, "policy": name, TRAINING: row["policy"]}
        for name, own in groups.items() for row in rows if row["policy"] in own
    ]  # fmt: skip


def note_on_groups(rows: Sequence[Row]) -> str:
    """Return the note on the intervals of groups; nothing without groups."""
    found = dict.fromkeys(str(row["policy"]) for row in rows if TRAINING in row)
    return NOTE.format(", ".join(found)) if found else ""


def interval_of(rows: Sequence[Row], value: Value) -> Interval:
    """Return the mean of rows with its 95% interval, over trainings too if they are of a group."""
    if not any(TRAINING in row for row in rows):
        return mean_interval(map(value, rows))
    return crossed_interval(_crossed(rows, value, EPISODE, rows))


def difference_of(rows: Sequence[Row], other: Sequence[Row], value: Value, names: Sequence[str] = EPISODE) -> Interval:
    """Return the mean difference of rows from other rows with the same named fields, as `crossed_interval` gives it."""
    known = {values_of(row, names) for row in other}
    common = [row for row in rows if values_of(row, names) in known]
    return crossed_interval(*(_crossed(side, value, names, common) for side in (rows, other)))


def _crossed(rows: Sequence[Row], value: Value, names: Sequence[str], common: Sequence[Row]) -> NDArray[np.float64]:
    """Return float64[trainings, episodes] for the episodes of the rows `common`; NaN where a value is missing."""
    found = {(row.get(TRAINING), values_of(row, names)): value(row) for row in rows}
    trainings, episodes = dict.fromkeys(one for one, _ in found), dict.fromkeys(values_of(row, names) for row in common)
    shape = len(trainings), len(episodes)
    return np.array([found.get((one, key)) for one in trainings for key in episodes], np.float64).reshape(shape)


def crossed_interval(*sides: NDArray[np.float64]) -> Interval:
    """Return the mean of float64[trainings, episodes], or its difference from another of the same episodes.

    Episodes in which a value is missing do not count. A single row is one fixed policy. The interval is that of NOTE.
    """
    whole = ~np.isnan(np.vstack(sides)).any(axis=0)
    if not whole.any():
        return mean_interval([])
    sides = tuple(side[:, whole] for side in sides)
    means = [side.mean(axis=0) for side in sides]
    by_episode = means[0] - sum(means[1:])
    count, parts, shared = len(by_episode), list[tuple[float, int]](), 0.0  # parts: variance, degrees of freedom
    if count > 1:
        parts.append((by_episode.var(ddof=1) / count, count - 1))
    for side in (side for side in sides if len(side) > 1):
        trainings = side.mean(axis=1, keepdims=True)
        parts.append((trainings.var(ddof=1) / len(side), len(side) - 1))
        rest = side - trainings - side.mean(axis=0) + side.mean()
        shared += (rest**2).sum() / max(1, (len(side) - 1) * (count - 1)) / side.size
    if not parts:
        return mean_interval(by_episode.tolist())
    mean, total = float(by_episode.mean()), sum(part for part, _ in parts)
    variance = float(max(total - shared, *(part for part, _ in parts)))
    freedom = variance**2 / sum(part**2 / freedom for part, freedom in parts) if variance > 0 else 1.0
    half = t_quantile(freedom) * math.sqrt(variance)
    return Interval(mean, mean - half, mean + half, count)


@dataclass(frozen=True)
class Measure:
    """One column of the evaluation table: how to read it from a row, and in which unit to show it."""

    name: str
    heading: str
    value: Callable[[Row], float | None]
    factor: float = 1.0
    most: float = math.inf
    shown: bool = True  # in the table; the others only in `summarise`

    def interval(self, rows: Sequence[Row]) -> Interval:
        """Return mean and 95% interval over rows, the interval cut to the values that are possible."""
        return interval_of(rows, self.value).cut(self.most)


def field_of(name: str) -> Callable[[Row], float | None]:
    """Return a function that reads a field of a row; None if it is missing."""
    return lambda row: row.get(name)


def _per_km(name: str) -> Callable[[Row], float | None]:
    return lambda row: row[name] / row["robot_km"] if row.get("robot_km") and name in row else None


_COLUMNS = (
    Measure("collisions_per_km", "collisions/km", field_of("collisions_per_km")),
    Measure("robot_collisions_per_km", "robot-robot/km", _per_km("collisions_robot"), shown=False),
    Measure("shelf_collisions_per_km", "with shelves/km", _per_km("collisions_shelf")),
    Measure("person_collisions_per_km", "with people/km", _per_km("collisions_person"), shown=False),
    Measure("near_misses_per_km", "near misses/km", _per_km("near_misses"), shown=False),
    Measure("goals_per_robot_hour", "goals/robot-h", field_of("goals_per_robot_hour")),
    Measure("late_goals_per_robot_hour", "late goals/robot-h", field_of("late_goals_per_robot_hour")),
    Measure("stuck", "stuck %", field_of("stuck"), factor=100.0, most=1.0),
    Measure("deadlocks", "deadlocks", field_of("deadlocks")),
    Measure("longest_standing_s", "longest standing s", field_of("longest_standing_s")),
    Measure("waiting_share", "waiting %", field_of("waiting_share"), factor=100.0, most=1.0, shown=False),
    Measure("path_length_ratio", "driven/planned", field_of("path_length_ratio"), shown=False),
    Measure("ms_per_step", "ms/step", field_of("ms_per_step")),
)
_PEOPLE = (Measure("longest_person_kept_s", "longest person kept s", field_of("longest_person_kept_s")),)
_WORK = (
    Measure("served_share", "served %", field_of("served_share"), factor=100.0, most=1.0, shown=False),
    Measure("queueing_share", "queueing %", field_of("queueing_share"), factor=100.0, most=1.0),
    Measure("station_utilisation", "stations used %", field_of("station_utilisation"), factor=100.0, most=1.0),
    Measure("empty_driving", "empty driving %", field_of("empty_driving"), factor=100.0, most=1.0),
)
_ORDERS = (
    Measure("orders_per_hour", "orders/h", field_of("orders_per_hour")),
    Measure("order_median_s", "order median s", field_of("order_median_s")),
    Measure("order_p95_s", "order 95% s", field_of("order_p95_s")),
    Measure("orders_late", "late orders", field_of("orders_late")),
    Measure("orders_open", "open orders", field_of("orders_open"), shown=False),
)
_BATTERY = (
    Measure("charging_share", "charging %", field_of("charging_share"), factor=100.0, most=1.0),
    Measure("lowest_charge", "lowest charge %", field_of("lowest_charge"), factor=100.0, most=1.0),
    Measure("stranded", "stranded", field_of("stranded")),
)
_ONE_SHOT = (
    Measure("success_rate", "success %", field_of("success_rate"), factor=100.0, most=1.0),
    Measure("makespan_s", "makespan s", field_of("makespan_s")),
)
MEASURES = {measure.name: measure for measure in _COLUMNS + _PEOPLE + _WORK + _ORDERS + _BATTERY}
EVALUATION_NOTE = (
    "Means over episodes [95% interval by Student's t over episodes, cut at possible values]; a collision counts once "
    "per contact and pair; late: of the second half; stuck: share of robots that have not advanced for "
    "over a minute at the end; deadlocks: wait cycles per episode; longest standing: of any robot within a metre of "
    "one place, per episode."
)
_PEOPLE_NOTE = (
    " Longest person kept: longest time that a walking person had a robot within half a metre and advanced less than a "
    "metre."
)
_WORK_NOTE = (
    " Queueing: share of the robots' time spent waiting for an occupied place; stations used: share of the stations' "
    "time with a robot in service; empty driving: share of the metres driven without a load."
)
_ORDERS_NOTE = " Order median and 95%: time from release to drop-off; late: dropped off late, or overdue."
_NOTES = ((_PEOPLE, _PEOPLE_NOTE), (_WORK, _WORK_NOTE), (_ORDERS[:-1], _ORDERS_NOTE))


def measures_for(rows: Sequence[Row]) -> tuple[Measure, ...]:
    """Return the columns that apply to these rows: those of one-shot tasks, people, work, orders and batteries only
    if there are some.
    """
    parts = (_PEOPLE, _WORK, _ORDERS, _BATTERY)
    some = tuple(one for part in parts if any(part[0].name in row for row in rows) for one in part)
    ends = _ONE_SHOT if any(row["tasks"] == "one_shot" for row in rows) else ()
    return _COLUMNS[:-1] + some + ends + _COLUMNS[-1:]


def note_for(shown: Sequence[Measure]) -> str:
    """Return the note under a table of these columns."""
    return EVALUATION_NOTE + "".join(note for part, note in _NOTES if part[-1] in shown)


_LONG = 60.0  # [s] from which a note says why a robot stood


def longest_stand(rows: Sequence[Row]) -> Row | None:
    """Return the row of the episode with the longest stand, None if nobody stood _LONG."""
    told = [row for row in rows if row.get("longest_standing_why") and row["longest_standing_s"] >= _LONG]
    return max(told, key=lambda row: float(row["longest_standing_s"]), default=None)


def who_stood(rows: Sequence[Row]) -> str:
    """Return a note about the robot that stood longest: where, and whom it waited for; empty if none stood _LONG."""
    row = longest_stand(rows)
    if row is None:
        return ""
    short = short_names({str(row[name]) for row in rows for name in ("policy", "layout")})
    where = f"{short[str(row['policy'])]} on {short[str(row['layout'])]}, {row['robots']} robots, seed {row['seed']}"
    return f" Longest of all, {row['longest_standing_s']:.0f} s ({where}): {row['longest_standing_why']}."


_PLACE = ("layout", "num_agents")  # fields of a configuration that tables show


def aspects(config: EnvConfig) -> dict[str, str]:
    """Return what tables name of a configuration."""
    interval = f"{config.time_step * config.action_repeat:g} s"
    return {
        "traffic": written_traffic(config.traffic_spec), "planner": config.planner, "decision interval": interval,
    }  # fmt: skip


def config_of_row(row: Row) -> EnvConfig | None:
    """Return the configuration of a row; None if it has none that this version knows."""
    return _config(json.dumps(row.get("config")))


@cache
def _config(text: str) -> EnvConfig | None:
    try:
        return EnvConfig.from_dict(json.loads(text))
    except ConfigError:
        return None


def _by_aspect(rows: Sequence[Row]) -> dict[str, dict[str, dict[str, None]]]:
    """Return aspect -> value -> the short names of the policies driven with it."""
    short = short_names({str(row["policy"]) for row in rows})
    found: dict[str, dict[str, dict[str, None]]] = {}
    for row in rows:
        for name, value in aspects(config).items() if (config := config_of_row(row)) else ():
            found.setdefault(name, {}).setdefault(value, {})[short[str(row["policy"])]] = None
    return found


def labels(rows: Sequence[Row]) -> dict[str, str]:
    """Return for each policy its short name with its traffic, and with what else policies differ in."""
    short = short_names({str(row["policy"]) for row in rows})
    found = {name: groups for name, groups in _by_aspect(rows).items() if name == "traffic" or len(groups) > 1}
    for name, policy in short.items():
        values = [value for groups in found.values() for value, own in groups.items() if policy in own]
        short[name] = f"{policy} ({', '.join(values)})" if values else policy
    return short


def driven_with(rows: Sequence[Row]) -> str:
    """Return a note that names what policies are driven with, and warns where that differs."""
    found, parts = _by_aspect(rows), []
    unequal = [name for name, groups in found.items() if len(groups) > 1]
    for name, groups in found.items():
        named = [f"{value} ({', '.join(own)})" for value, own in groups.items()] if name in unequal else groups
        parts.append(f"{name} {', '.join(named)}")
    warning = f"Differences between these policies are also due to the {' and '.join(unequal)}. " if unequal else ""
    return f"Driven with {'; '.join(parts)}. {warning}" if parts else ""


def differing(*sides: Sequence[Row]) -> dict[str, tuple[str, ...]]:
    """Return the fields of configuration and version in which sets of rows differ, with the values of each set."""
    found = [{(name, str(value)): None for row in rows for name, value in _settings(row).items()} for rows in sides]
    names = sorted({name for name, _ in set().union(*found) - set(found[0]).intersection(*found)} - {*_PLACE})
    return {name: tuple(" or ".join(v for n, v in one if n == name) or "-" for one in found) for name in names}


def _settings(row: Row) -> dict[str, Any]:
    """Return configuration and version of a row, as flat as "reward.collision"."""
    config = config_of_row(row)
    flat = {"version": row.get("version", "-"), **({} if config is None else config.to_dict() | aspects(config))}
    parts = [(name, value) for name, value in flat.items() if isinstance(value, dict)]
    return flat | {f"{name}.{key}": one for name, part in parts for key, one in flat.pop(name, part).items()}
