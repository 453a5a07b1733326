"""Groups of trainings of one recipe: rows under the group's name, and intervals over trainings and episodes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from train.reporting.rows import Interval, Row, mean_interval, t_quantile, values_of
from warehouse_env.errors import ConfigError

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


def difference_of(
    rows: Sequence[Row], other: Sequence[Row], value: Value, names: Sequence[str] = EPISODE, coverage: float = 0.95
) -> Interval:
    """Return the mean difference of rows from other rows with the same named fields, as `crossed_interval` gives it."""
    known = {values_of(row, names) for row in other}
    common = [row for row in rows if values_of(row, names) in known]
    return crossed_interval(*(_crossed(side, value, names, common) for side in (rows, other)), coverage=coverage)


def _crossed(rows: Sequence[Row], value: Value, names: Sequence[str], common: Sequence[Row]) -> NDArray[np.float64]:
    """Return float64[trainings, episodes] for the episodes of the rows `common`; NaN where a value is missing."""
    found = {(row.get(TRAINING), values_of(row, names)): value(row) for row in rows}
    trainings, episodes = dict.fromkeys(one for one, _ in found), dict.fromkeys(values_of(row, names) for row in common)
    shape = len(trainings), len(episodes)
    return np.array([found.get((one, key)) for one in trainings for key in episodes], np.float64).reshape(shape)


def crossed_interval(*sides: NDArray[np.float64], coverage: float = 0.95) -> Interval:
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
    half = t_quantile(freedom, coverage) * math.sqrt(variance)
    return Interval(mean, mean - half, mean + half, count)
