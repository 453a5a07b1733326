"""A table of a paper as data: the maps, the systems that are compared, the printed figures and the claims.

A module lists its `STUDIES`. Running, resuming, tables and verdicts are the same for all (`runner.py`). Lengths are in
cells, times in milliseconds, shares from 0 to 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from train.reporting.rows import Row
from train.tables.measures import MEASURES, TableFigures
from warehouse_env.errors import ConfigError, unknown_name
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Planner, make_planner, min_turns

Word = Literal["holds", "holds in part", "does not hold", "cannot be told"]
HOLDS: Final = "holds"
IN_PART: Final = "holds in part"
FAILS: Final = "does not hold"
OPEN: Final = "cannot be told"


class TableTask(NamedTuple):
    """A map with a start and a goal on it; others: start and goal of whatever else moves in an experiment."""

    grid: GridMap
    start: Cell
    goal: Cell
    others: tuple[tuple[Cell, Cell], ...] = ()

    @property
    def ends(self) -> tuple[tuple[Cell, Cell], ...]:
        """Start and goal of everything that moves."""
        return ((self.start, self.goal), *self.others)


Experiment = Callable[[TableTask, Planner, np.random.Generator], Row]
"""From a task, a system's planner and a generator to a row with the fields that the study's measures read."""


class TableSetting(NamedTuple):
    """A group of lines of the table: one map, or several random ones of one kind.

    With one task a sample is a run. With several a sample is the mean of a map's runs, so intervals are over maps.
    """

    name: str
    tasks: tuple[TableTask, ...]


@dataclass(frozen=True)
class TableSystem:
    """A planner with its parameters, as one line of the table; `label` is unique in a study, e.g. "pf_aco (paper)".

    experiment: what a run does with the planner; one plan of the task if None.
    """

    label: str
    planner: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    experiment: Experiment | None = None

    def make(self) -> Planner:
        """Build the planner; ConfigError for a wrong name or parameter."""
        return make_planner(self.planner, **self.parameters)


def driven_row(grid: GridMap, ends: Sequence[tuple[Cell, Cell]], success: bool, length: float, last: float) -> Row:
    """Return the figures of an experiment that drove robots between all ends, None for those of a drive that failed.

    length: of all robots together [cells]; last: the time of the last arrival [s].
    """
    optimum = sum(float(grid.distance_to(goal)[start]) for start, goal in ends)
    figures = {"length": length, "last": last, "gap": length / optimum - 1}
    told = {name: value if success else None for name, value in figures.items()}
    turns = sum(min_turns(grid, *one) for one in ends)
    return {"success": success, **told, "optimal_length": optimum, "min_turns": turns}


class Published(NamedTuple):
    """A figure that the paper prints.

    system: what the paper calls it; ours: the label of our system that it belongs beside, "" for a line of its own.
    value: in the unit of the measure: cells, milliseconds, shares from 0 to 1.
    """

    setting: str
    system: str
    measure: str
    value: float
    ours: str = ""


def published(
    measures: Sequence[str], lines: Iterable[tuple[str, str, str, Sequence[float | None]]]
) -> tuple[Published, ...]:
    """Return the figures of printed lines (setting, system, ours, values): a value a measure, None where none is."""
    return tuple(
        Published(setting, system, measure, value, ours)
        for setting, system, ours, values in lines
        for measure, value in zip(measures, values, strict=True)
        if value is not None
    )


class ClaimVerdict(NamedTuple):
    """The verdict on a claim, and the figures behind it.

    by_clock: it rests on times, so another machine may judge otherwise; such verdicts are shown but not counted.
    """

    word: Word
    why: str
    by_clock: bool = False

    @classmethod
    def graded(cls, holds: Sequence[bool], why: str) -> ClaimVerdict:
        """Return the verdict on a claim that holds in some places: in all, in part, nowhere; open if there are none."""
        if not holds:
            return cls(OPEN, "nothing was run for it")
        return cls(HOLDS if all(holds) else IN_PART if any(holds) else FAILS, why)

    @property
    def shown(self) -> str:
        """The word as it stands on a page, in Markdown."""
        return f"**{self.word}**" + (", by this machine's clock" if self.by_clock else "")


@dataclass(frozen=True)
class Claim:
    """`ours` has a better `measure` than `other`, by `by` where a size is given.

    by: relative to `other` (-0.14: 14% less); for a share, a difference of shares (0.5: 50 points more).
    settings: names of the settings that it is claimed for; all if empty. `check` replaces the general rule where a
    claim has another form, and reads no times; `measure`, `ours` and `other` are then unused.
    """

    text: str
    ours: str = ""
    other: str = ""
    measure: str = ""
    by: float | None = None
    settings: tuple[str, ...] = ()
    check: Callable[[TableFigures], ClaimVerdict] | None = None


@dataclass(frozen=True)
class TableStudy:
    """One table: what is run for it, what the paper prints, what it claims.

    settings: a function, so that maps are built only where they are needed; it must give the same maps every time.
    runs: of each system on each task; measures: names of MEASURES, the columns.
    note: what is a reconstruction, and what differs from the paper; Markdown, shown under the table.
    """

    name: str
    paper: str
    title: str
    settings: Callable[[], tuple[TableSetting, ...]]
    systems: tuple[TableSystem, ...]
    runs: int
    measures: tuple[str, ...]
    published: tuple[Published, ...] = ()
    claims: tuple[Claim, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        """Refuse unknown names, so that a wrong table is noticed before it is run."""
        labels = [system.label for system in self.systems]
        if len(set(labels)) != len(labels):
            raise ConfigError(f"study {self.name}: two systems have one label; labels must differ")
        ruled = [claim for claim in self.claims if claim.check is None]
        measures = (*self.measures, *(p.measure for p in self.published), *(claim.measure for claim in ruled))
        for measure in measures:
            if measure not in MEASURES:
                raise unknown_name(f"study {self.name}: measure", measure, MEASURES)
        named = (*(p.ours for p in self.published if p.ours), *(name for c in ruled for name in (c.ours, c.other)))
        for label in named:
            if label not in labels:
                raise unknown_name(f"study {self.name}: system", label, labels)
