"""`warehouse tables papers` and `warehouse tables planners`: run studies as jobs, and write them as one page.

A job is a block: all runs of one system on one task. Its rows carry everything that made them, so that changed code,
maps or parameters are run again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

import warehouse_env
from train.evaluation.jobs import Job, Result, Tick, code_of
from train.evaluation.planning_runs import make_task, plan_once
from train.reporting.report import Table, number, with_interval
from train.reporting.rows import Row
from train.tables.catalogue import EXPERIMENTS, PAPERS, settings_of, studies_of
from train.tables.measures import MEASURES, TableFigures
from train.tables.options import TableOptions
from train.tables.published import against_published
from train.tables.study import ClaimVerdict, PrintedLine, TableStudy, TableSystem, TableTask
from train.tables.verdicts import RULE, judge, verdict_counts
from warehouse_env.errors import check_known

PLANNING = ("warehouse_env/maps", "warehouse_env/planning")  # the code that makes a plan
EXPERIMENT = (*PLANNING, "train/tables")  # the code that makes an experiment's row
INTERVALS = (
    "Means with 95% intervals: Student's t over runs where a setting is one map, over maps where it has several; "
    "Wilson's score for shares on one map. n: runs of each system, times maps. Lengths in cells; times are medians of "
    "processor time in milliseconds, without compilation. Lines in italics are printed in the paper."
)


@dataclass(frozen=True)
class PlanBlock(Job):
    """All runs of one system on one task of a setting, in names and numbers only."""

    file: str  # of the study, in `studies`
    study: str
    setting: str
    number: int  # of the task in its setting
    system: str
    runs: int
    seed: int

    titled = "{study} · {system}"
    times = ("ms", "cpu_ms")

    def subject(self) -> tuple[TableTask, TableSystem]:
        """Return the task and the system."""
        systems = {system.label: system for system in studies_of(self.file)[self.study].systems}
        return settings_of(self.file, self.study)[self.setting].tasks[self.number], systems[self.system]

    @property
    def identity(self) -> Row:
        """Fields by which its rows are recognised."""
        task, system = self.subject()
        return {
            "study": self.study, "setting": self.setting, "number": self.number, "system": self.system,
            "runs": self.runs, "seed": self.seed, "map": task.grid.key, "start": list(task.start),
            "goal": list(task.goal), "others": [[list(start), list(goal)] for start, goal in task.others],
            "parameters": system.make().key, "experiment": system.experiment, "version": warehouse_env.__version__,
            "code": code_of(*(EXPERIMENT if system.experiment else PLANNING)),
        }  # fmt: skip

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Self | None]:
        """Return the rows of all runs, if none is missing."""
        own = {row["run"]: row for row in rows if isinstance(row.get("run"), int)}
        whole = all(run in own for run in range(self.runs))
        return ([own[run] for run in range(self.runs)], None) if whole else ([], self)

    def run(self, tick: Tick) -> Result:
        """Do all runs. A first plan, which may compile and fill caches, is not timed."""
        given, system = self.subject()
        planner, identity, grid = system.make(), self.identity, given.grid
        if system.experiment:
            draws = [np.random.default_rng([self.seed, self.number, run]) for run in range(self.runs)]
            rows = [EXPERIMENTS[system.experiment](given, planner, rng) for rng in draws]
            return Result([{**row, **identity, "run": run} for run, row in enumerate(rows)])
        task = make_task(grid, f"{self.setting}_{self.number}", given.start, given.goal)
        plan_once(grid, planner, task, self.number, 0, self.seed)
        runs = (plan_once(grid, planner, task, self.number, run, self.seed) for run in range(self.runs))
        return Result([{**one.row, **identity} for one in runs])


@dataclass(frozen=True)
class Studies(TableOptions):
    """Options of commands that run studies."""

    runs: int | None = None
    """Runs of each system on each task (each table's own number if left out)."""

    title: ClassVar[str]

    def chosen(self) -> list[tuple[str, TableStudy]]:
        """Return (file, study) of each requested table."""
        raise NotImplementedError

    def run(self) -> list[Row]:
        """Run what is missing and write the page; return the rows."""
        chosen = self.chosen()
        blocks = [
            PlanBlock(file, study.name, setting.name, number, system.label, self.runs or study.runs, self.seed)
            for file, study in chosen
            for setting in settings_of(file, study.name).values()
            for system in study.systems
            for number in range(len(setting.tasks))
        ]
        rows = self.rows_of(blocks, self.page, mixed=True)
        text, tables, verdicts = f"{INTERVALS}\n\n", list[Table](), list[ClaimVerdict]()
        for _, study in chosen:
            figures = TableFigures(study.name, rows)
            tables.append(study_table(study, figures))
            if study.claims:
                own = [judge(figures, claim, study.printed) for claim in study.claims]
                lines = ((one.shown, claim.text, one.why) for one, claim in zip(own, study.claims, strict=True))
                tables.append(Table(f"Claims: {study.title}", ("verdict", "claim", "ours"), tuple(lines)))
                verdicts += own
        if verdicts:
            print(verdict_counts(verdicts))
            text += f"{verdict_counts(verdicts)}\n\n{RULE}\n\n"
        self.write(self.title, tables, text)
        return rows


@dataclass(frozen=True)
class PapersTable(Studies):
    """Make the tables of the papers: our figures beside theirs, and a verdict on every claim.

    The page shows the requested papers; the rows of others stay in the file.
    """

    title: ClassVar[str] = "The papers' tables, made again"

    papers: tuple[str, ...] = ()
    """Papers by number, as 000 (all if left out)."""
    check: bool = False
    """Compare each line with the published one; exit code 1 if a figure lies outside its interval. With --resume it
    takes finished rows."""

    def run(self) -> list[Row]:
        """Run what is missing, write the page, and compare it with the published rows if asked to."""
        rows = super().run()
        if self.check:
            compared, outside = against_published([study for _, study in self.chosen()], rows)
            compared.print()
            if outside:
                raise SystemExit(1)
        return rows

    def chosen(self) -> list[tuple[str, TableStudy]]:
        """Return the tables of the named papers; WarehouseError for a wrong name."""
        check_known("paper", self.papers, PAPERS)
        return [(file, study) for file in dict.fromkeys(self.papers or PAPERS) for study in studies_of(file).values()]


@dataclass(frozen=True)
class PlannersTable(Studies):
    """Plan the same pairs of cells on five floors by every planner: length, turns, clearance, failures and time."""

    name: ClassVar[str] = "planners"
    title: ClassVar[str] = "Every planner on the same pairs of cells"

    def chosen(self) -> list[tuple[str, TableStudy]]:
        """Return the one study."""
        return [("planners", study) for study in studies_of("planners").values()]


def study_table(study: TableStudy, figures: TableFigures) -> Table:
    """Return a study's table: for each setting our systems, each with the printed lines that stand beside it."""
    lines: list[tuple[str, ...]] = []
    for setting in figures.settings:
        begin = len(lines)
        printed = [line for line in study.printed if line.setting == setting]
        for system in study.systems:
            tasks = figures.tasks(setting, system.label)
            if not tasks:
                continue
            count = f"{len(tasks[0])}" if len(tasks) == 1 else f"{len(tasks[0])} x {len(tasks)}"
            found = ((figures.figure(setting, system.label, name), MEASURES[name]) for name in study.measures)
            texts = (with_interval(interval, measure.factor, measure.digits) for interval, measure in found)
            lines.append(("", system.label, count, *texts))
            lines += [_printed_line(one, study.measures) for one in printed if one.ours == system.label]
        lines += [_printed_line(one, study.measures) for one in printed if not one.ours]
        if len(lines) > begin:
            label = study.systems[0].label
            optimum, fewest = (figures.figure(setting, label, name).mean for name in ("optimum", "min_turns"))
            named = f"**{setting}** (optimum {number(optimum, 6)}, {number(fewest, 3)} turns)"
            lines[begin] = (named, *lines[begin][1:])
    header = ("setting", "system", "n", *(MEASURES[measure].heading for measure in study.measures))
    return Table(study.title, header, tuple(lines), f"{study.paper}. {study.note}")


def _printed_line(printed: PrintedLine, names: Sequence[str]) -> tuple[str, ...]:
    """Return the line of a system in print, in italics."""
    known = {name: (value * MEASURES[name].factor, MEASURES[name].digits) for name, value in printed.figures.items()}
    return "", f"*in print: {printed.system}*", "", *(f"*{number(*known[k])}*" if k in known else "" for k in names)
