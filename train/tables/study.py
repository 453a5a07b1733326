"""A table of a paper as data: the maps, the systems that are compared, the printed figures and the claims.

`studies/*.toml` hold the studies, `catalogue.py` reads them. `runner.py` runs them and writes
the tables. Lengths are in cells, times in milliseconds, shares from 0 to 1.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, Self

import numpy as np

from train.reporting.rows import Row
from train.tables.measures import MEASURES
from warehouse_env.checked import CheckedPart
from warehouse_env.errors import ConfigError, check_known
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Planner, make_planner, min_turns

Word = Literal["holds", "holds in part", "does not hold", "undecided"]
HOLDS: Final = "holds"
IN_PART: Final = "holds in part"
FAILS: Final = "does not hold"
OPEN: Final = "undecided"


class TableTask(NamedTuple):
    """A map with a start and a goal on it; others: start and goal of everything else that moves in an experiment."""

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
class TableSystem(CheckedPart):
    """One line of the table; `label` is unique in a study, e.g. "pf_aco (paper)".

    planner: as `make_planner` reads it, with parameters. experiment: a name of `catalogue.EXPERIMENTS`, which says what
    a run does with the planner; one plan of the task if left out.
    """

    label: str
    planner: str
    experiment: str = ""

    def make(self) -> Planner:
        """Build the planner; ConfigError for a wrong name or parameter."""
        return make_planner(self.planner)


def driven_row(grid: GridMap, ends: Sequence[tuple[Cell, Cell]], success: bool, length: float, last: float) -> Row:
    """Return the figures of an experiment that drove robots between all ends, None for those of a drive that failed.

    length: of all robots together [cells]; last: the time of the last arrival [s].
    """
    optimum = sum(float(grid.distance_to(goal)[start]) for start, goal in ends)
    figures = {"length": length, "last": last, "gap": length / optimum - 1}
    told = {name: value if success else None for name, value in figures.items()}
    turns = sum(min_turns(grid, *one) for one in ends)
    return {"success": success, **told, "optimal_length": optimum, "min_turns": turns}


@dataclass(frozen=True)
class PrintedLine(CheckedPart):
    """Figures that the paper prints for one system in one setting.

    system: what the paper calls it; ours: the label of our system that it belongs beside, "" for a line of its own.
    figures: values by measure, in the unit of the measure: cells, milliseconds, shares from 0 to 1.
    """

    setting: str
    system: str
    figures: dict[str, float]
    ours: str = ""


class ClaimVerdict(NamedTuple):
    """The verdict on a claim, and the figures behind it.

    by_clock: it rests on times, so another machine may judge otherwise; such verdicts are shown but not counted.
    """

    word: Word
    why: str
    by_clock: bool = False

    @classmethod
    def graded(cls, holds: Sequence[bool], why: str) -> Self:
        """Return the verdict on a claim that holds in some places: in all, in part, nowhere; open if there are none."""
        if not holds:
            return cls(OPEN, "nothing was run for it")
        return cls(HOLDS if all(holds) else IN_PART if any(holds) else FAILS, why)

    @property
    def shown(self) -> str:
        """The word as it stands on a page, in Markdown."""
        return f"**{self.word}**" + (", by this machine's clock" if self.by_clock else "")


@dataclass(frozen=True)
class Claim(CheckedPart):
    """`ours` has a better `measure` than `other`, by `by` where a size is given.

    by: relative to `other` (-0.14: 14% less); for a share, a difference of shares (0.5: 50 points more).
    settings: names of the settings that it is claimed for; all if empty. check: a name of `verdicts.CHECKS`, for a
    claim of another form. printed: a figure in print that a check compares with. why_open: why it cannot be judged.
    """

    text: str
    ours: str = ""
    other: str = ""
    measure: str = ""
    by: float | None = None
    settings: tuple[str, ...] = ()
    check: str = ""
    printed: float = 0.0
    why_open: str = ""


@dataclass(frozen=True)
class TableStudy(CheckedPart):
    """One table: what is run for it, what the paper prints, what it claims.

    settings: a name of `catalogue.SETTINGS`; runs: of each system on each task; measures: names of MEASURES, the
    columns. note: what is a reconstruction, and what differs from the paper; Markdown, shown under the table.
    """

    name: str
    paper: str
    title: str
    settings: str
    systems: tuple[TableSystem, ...]
    runs: int
    measures: tuple[str, ...]
    printed: tuple[PrintedLine, ...] = ()
    claims: tuple[Claim, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        """Refuse unknown names, so that a wrong table is noticed before it is run."""
        super().__post_init__()
        labels = [system.label for system in self.systems]
        if len(set(labels)) != len(labels):
            raise ConfigError(f"study {self.name}: two systems have one label; labels must differ")
        measures = [*self.measures, *(name for line in self.printed for name in line.figures)]
        measures += [claim.measure for claim in self.claims]
        named = [name for claim in self.claims for name in (claim.ours, claim.other)]
        check_known(f"study {self.name}: measure", filter(None, measures), MEASURES)
        check_known(f"study {self.name}: system", filter(None, [*named, *(line.ours for line in self.printed)]), labels)
