"""`warehouse compare RUN [RUN]`: evaluations side by side, with paired differences -> a table, and rows."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import tyro

from train.reporting.columns import (
    EPISODE,
    MEASURES,
    Measure,
    difference_of,
    differing,
    note_on_groups,
    read_groups,
    regrouped,
)
from train.reporting.report import Table, difference, grouped, with_interval
from train.reporting.rows import Interval, Row, RowFile, is_significant, read_rows, select, short_names, values_of
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, WarehouseError

_NEEDED = ("policy", "layout", "robots", "tasks", "planner", "seed", "robot_km", "collisions_per_km")
_COMPARED = (
    "goals_per_robot_hour", "collisions_per_km", "stuck", "waiting_share", "longest_standing_s", "path_length_ratio",
    "orders_per_hour", "order_median_s", "order_p95_s", "orders_late", "station_utilisation", "empty_driving",
)  # fmt: skip


def _fits(name: str, value: object) -> bool:
    """Return whether a field of a row holds what can be compared."""
    if name in ("robots", "seed"):
        return isinstance(value, int) and not isinstance(value, bool)
    if name in _COMPARED:
        return value is None or (isinstance(value, (int, float)) and abs(value) < 1e150)  # so that squares can be added
    return isinstance(value, str) or (name == "disturbance" and value is None)


_MORE_IS_BETTER = ("goals_per_robot_hour", "orders_per_hour")
_NEITHER = ("station_utilisation",)  # measures without a better direction
NOTE = (
    "Over the episodes that both have: the same floor, number of robots and seed. Difference: mean of the paired "
    "differences [95% interval by Student's t], the run minus the run it is compared with; better or worse if the "
    "interval excludes 0. Intervals are not corrected: one in twenty equal measures looks different."
)


Runs = Mapping[str, list[Row]]
"""The rows of evaluations by distinct names."""


class System(NamedTuple):
    """A policy of a run."""

    run: str
    policy: str


class Line(NamedTuple):
    """A measure of two systems, compared over their common episodes on one floor."""

    layout: str
    robots: int
    ours: System
    other: System
    measure: Measure
    found: Interval
    base: Interval
    difference: Interval
    differing: dict[str, tuple[str, ...]]  # fields of configuration and version -> ours, the other's

    @property
    def verdict(self) -> str:
        """Better, worse, more, less, equal in every episode, or what may be chance (0 is in the interval)."""
        if self.difference.samples > 1 and self.difference[:3] == (0.0, 0.0, 0.0):
            return "equal"
        if not is_significant(self.difference):
            return "may be chance"
        if self.measure.name in _NEITHER:
            return "more" if self.difference.mean > 0 else "less"
        return "better" if (self.difference.mean > 0) == (self.measure.name in _MORE_IS_BETTER) else "worse"

    def row(self) -> Row:
        """Return it in JSON types, in the units of the rows (shares from 0 to 1)."""
        numbers: dict[str, Any] = {"episodes": self.difference.samples}
        for name, interval in (("run", self.found), ("base", self.base), ("difference", self.difference)):
            numbers |= {name: interval.mean, f"{name}_low": interval.low, f"{name}_high": interval.high}
        about = {"layout": self.layout, "robots": self.robots, "measure": self.measure.name}
        systems = {"of": self.ours._asdict(), "against": self.other._asdict()}
        return {**about, **systems, **numbers, "verdict": self.verdict, "differing": self.differing}


def read_runs(paths: Sequence[Path]) -> Runs:
    """Return the runs in files of rows, or in folders that hold rows.jsonl, by distinct names.

    Raises WarehouseError for none, for missing files, and for rows that do not come from an evaluation.
    """
    if not paths:
        raise WarehouseError("name runs to compare: files of rows that `warehouse evaluate` wrote, or their folders")
    files = [path / "rows.jsonl" if path.is_dir() else path for path in paths]
    names = [file.parent.name if file.stem == "rows" and file.parent.name else file.stem for file in files]
    counts = Counter(names)
    names = [name if counts[name] == 1 else str(path) for name, path in zip(names, paths, strict=True)]
    if len(set(names)) < len(names):
        raise WarehouseError(f"{Counter(names).most_common(1)[0][0]} is named twice; a run is compared with another")
    return {name: _rows(file) for name, file in zip(names, files, strict=True)}


def _rows(file: Path) -> list[Row]:
    rows = read_rows(file)
    missing = [name for name in _NEEDED if any(name not in row for row in rows)]
    if not rows or missing:
        lack = f"its rows lack {missing[0]!r}" if missing else "it is empty"
        raise WarehouseError(f"{file} holds no rows of `warehouse evaluate`: {lack}")
    checked = ("policy", "layout", "tasks", "robots", "seed", "disturbance", *_COMPARED)
    wrong = next((name for row in rows for name in checked if not _fits(name, row.get(name))), None)
    if wrong is not None:
        raise WarehouseError(f"{file} holds no rows of `warehouse evaluate`: a {wrong} is none")
    for key, own in grouped(rows, ("policy", *EPISODE)).items():
        if len(own) > 1:
            raise WarehouseError(f"{file} holds {len(own)} rows of {key[0]} with seed {key[-1]} on {key[1]}; keep one")
    return rows


def compare(runs: Runs, policies: Sequence[str] = ()) -> list[Line]:
    """Compare every further run with the first: each policy with itself, or a single policy with a single one.

    In a single run every further policy is compared with the first. policies: those to compare; empty: all. Raises
    WarehouseError if there is nothing to pair.
    """
    lines, systems = [], []
    for name, rows in runs.items():
        names = dict.fromkeys(str(row["policy"]) for row in rows)
        systems.append([System(name, policy) for policy in names if not policies or policy in policies])
    for ours, other in _pairs(systems):
        mine, theirs = (select(runs[one.run], policy=one.policy) for one in (ours, other))
        lines += _lines(ours, other, mine, theirs)
    if not lines:
        raise WarehouseError("the runs have no episode in common: none of the same floor, number of robots and seed")
    return lines


def _pairs(systems: Sequence[Sequence[System]]) -> list[tuple[System, System]]:
    """Return what is compared with what, from the systems of each run."""
    first, *others = systems
    if not others:
        if len(first) < 2:
            raise WarehouseError("name a second run to compare with, or a run of two policies or more")
        return [(one, first[0]) for one in first[1:]]
    pairs = []
    for own in others:
        same = [(a, b) for a, b in product(own, first) if a.policy == b.policy]
        if not same and len(own) == len(first) == 1:
            same = [(own[0], first[0])]
        if not same:
            raise WarehouseError("two runs have no policy in common, and more than one each; name one by --policy")
        pairs += same
    return pairs


def _lines(ours: System, other: System, mine: Sequence[Row], theirs: Sequence[Row]) -> list[Line]:
    """Return a line for each floor, number of robots and measure of which both have something."""
    lines = []
    for (layout, robots), group in grouped(mine, ("layout", "robots")).items():
        base = select(theirs, layout=layout, robots=robots)
        common = {values_of(row, EPISODE) for row in group} & {values_of(row, EPISODE) for row in base}
        group, base = ([row for row in rows if values_of(row, EPISODE) in common] for rows in (group, base))
        unequal = differing(group, base)
        for measure in (MEASURES[name] for name in _COMPARED):
            found = difference_of(group, base, measure.value)
            if found.samples:
                means = measure.interval(group), measure.interval(base)
                lines.append(Line(str(layout), int(str(robots)), ours, other, measure, *means, found, unequal))
    return lines


def comparison_table(lines: Sequence[Line], note: str = "") -> Table:
    """Return a line for each measure of each pair on each floor; note: what follows the others below it."""
    short = short_names({name for line in lines for name in (line.layout, line.ours.policy, line.other.policy)})
    same = all(line.ours.policy == line.other.policy for line in lines)
    one_run = len({system.run for line in lines for system in (line.ours, line.other)}) == 1
    cells, unequal = [], dict[str, None]()
    for line in lines:
        systems = line.ours, line.other
        names = [
            one.run if same else short[one.policy] if one_run else f"{one.run}: {short[one.policy]}" for one in systems
        ]
        factor = line.measure.factor
        told = difference(line.difference, factor)
        cells.append((
            short[line.layout], str(line.robots), *((short[line.ours.policy],) if same else ()), line.measure.heading,
            names[0], with_interval(line.found, factor), names[1], with_interval(line.base, factor),
            str(line.difference.samples), told, line.verdict,
        ))  # fmt: skip
        what = "; ".join(f"{name} {' / '.join(values)}" for name, values in line.differing.items())
        unequal |= {f"{' / '.join(names)} differ in {what}. ": None} if what else {}
    policy = ("policy",) if same else ()
    header = ("floor", "robots", *policy, "measure", "run", "mean", "against", "its mean", "episodes", "difference", "")
    return Table("Comparison", header, tuple(cells), "".join(unequal) + NOTE + note)


@dataclass(frozen=True)
class Compare(Checked):
    """Compare runs of `warehouse evaluate` with the first one, over the episodes that both have.

    Each policy is compared with itself in the other run; runs with a single policy each are compared as they are. In a
    single run every policy is compared with the first.
    Example: warehouse compare results/before results/after
    """

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Files of rows that `warehouse evaluate` wrote, or folders with rows.jsonl in them (as a report is)."""
    policy: tuple[str, ...] = ()
    """Compare only these policies and groups (default: all)."""
    group: tuple[str, ...] = ()
    """Compare groups of policies of the runs, named as for `warehouse evaluate`."""
    json: Path | None = None
    """File for the figures, a row for each measure, pair and floor, as JSON lines."""

    def run(self) -> None:
        """Read all runs, print the table, write the rows."""
        groups = read_groups(self.group)
        runs = {name: regrouped(rows, groups, self.policy) for name, rows in read_runs(self.runs).items()}
        every = [row for rows in runs.values() for row in rows]
        if missing := groups.keys() - {row["policy"] for row in every}:
            raise ConfigError(f"--group {min(missing)}: no run has rows of its policies")
        lines = compare(runs, self.policy)
        file = RowFile(self.json)
        comparison_table(lines, note_on_groups(every)).print()
        file.add(line.row() for line in lines)
        episodes = sum(line.difference.samples for line in lines if line.measure == lines[0].measure)
        print(f"compared {episodes} pairs of episodes; {file.written()}")
