"""`warehouse tables`: every comparison table of the papers, from fixed seeds, in blocks that survive a stop."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from train.evaluation.rollout import MOST
from train.reporting.report import require_charts
from train.reporting.rows import Row, RowFile, check_writable, whole_rows, write_rows
from train.tables.blocks import Block, blocks_of, mixed, run_block, split
from train.tables.catalogue import chosen
from train.tables.page import write_pages
from train.tables.pieces import run_missing
from train.tables.study import Study
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError


@dataclass(frozen=True)
class Tables(Checked):
    """Make the tables of the papers: ours beside theirs, a verdict on every claim, pictures, all planners at once."""

    papers: tuple[str, ...] = ()
    """Papers by number, as 000 (all if neither papers nor tables are named); "all" compares all planners."""
    tables: tuple[str, ...] = ()
    """Single tables by name, as 000_table_1."""
    runs: int | None = None
    """Runs of each system on each task (of --learning: episodes), instead of each study's own number."""
    seed: int = 0
    """Seed of the runs; the maps are fixed."""
    processes: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Blocks to run at a time, each in a process of its own; the rows stay the same but for the times."""
    fresh: bool = False
    """Run everything again, instead of keeping the rows that the file holds already."""
    json: Path | None = None
    """File for the rows, one a run, as JSON lines (OUT/rows.jsonl if left out)."""
    out: Path = Path("results/tables")
    """Folder for the rows, the tables and the pictures."""
    pictures: bool = True
    """Draw paths, convergence, and gap against time."""
    benchmark: bool = False
    """Run the benchmark of all planners on five maps instead of the papers' tables."""
    traffic: bool = False
    """Run the study of several robots' routes: conflicts, choices of routes, replanning, what driving makes of it."""
    learning: bool = False
    """Train five seeds of each algorithm, drive them and the rules under all options, and say what learning adds."""
    floors: bool = False
    """Drive policies and the rule on named floors, benchmark maps and 20 floors drawn at random, 16 to 128 robots."""
    policy: tuple[str, ...] = ()
    """Of --floors: policies to hold against the rule, names or folders (threaded_ppo if left out)."""
    robots: tuple[int, ...] = (16, 32, 64, 128)
    """Of --floors: numbers of robots."""
    trainings: int = 5
    """Of --learning: seeds of each algorithm."""
    steps: int = 4_000_000
    """Of --learning: agent-steps of each training."""
    pairs: int = 200
    """Of the benchmark: pairs of cells planned on each map."""
    maps: tuple[str, ...] = ()
    """Of the benchmark: its maps by name, or MovingAI .map files (its five if left out); of other studies: layouts."""
    planner: tuple[str, ...] = ()
    """Of the benchmark: planners, ours and other libraries' by name (all that are installed if left out)."""

    def run(self) -> None:
        """Run what is missing, then write tables, verdicts and pictures."""
        for option, count in (("--runs", self.runs), ("--pairs", self.pairs)):
            if count is not None and not 1 <= count <= MOST:
                raise ConfigError(f"{option} {count} must lie in 1..{MOST:,}")
        if self.seed < 0 or self.processes < 1:
            raise ConfigError(f"--seed {self.seed} must be at least 0 and --processes {self.processes} at least 1")
        studies = self.benchmark + self.traffic + self.learning + self.floors
        if studies > 1:
            names = "--benchmark, --traffic, --learning and --floors"
            raise ConfigError(f"{names} are studies of their own; ask for one at a time")
        if self.pictures:
            require_charts()
        if studies:
            self._run_study()
        else:
            self._compare_with_papers()

    def _compare_with_papers(self) -> None:
        """Make the tables of the papers."""
        begin = time.perf_counter()
        studies = chosen(self.papers, self.tables)
        check_writable(self.out / "README.md")
        rows = self._rows(studies)
        before = self._made_before(studies)
        written = write_pages(
            [study for _, study in studies], rows, before, self.out, pictures=self.pictures, processes=self.processes
        )
        print(f"wrote {written} files to {self.out} in {time.perf_counter() - begin:.0f} s; begin with README.md")

    def _run_study(self) -> None:
        """Run one of the studies that have tables of their own."""
        names = ("out", "json", "runs", "seed", "processes", "fresh", "maps")
        options: dict[str, Any] = {name: getattr(self, name) for name in names}
        if self.floors:
            from train.tables.floors.command import Floors

            Floors(**options, policy=self.policy, robots=self.robots).run()
            return
        options["pictures"] = self.pictures
        if self.benchmark:
            from train.tables.benchmark.command import Benchmark

            Benchmark(**options, pairs=self.pairs, planner=self.planner).run()
        elif self.learning:
            from train.tables.learning.command import Learning

            Learning(**options, trainings=self.trainings, steps=self.steps).run()
        else:
            from train.tables.traffic.command import Traffic

            Traffic(**options).run()

    @property
    def _path(self) -> Path:
        return self.json or self.out / "rows.jsonl"

    def _made_before(self, studies: Sequence[tuple[str, Study]]) -> list[tuple[Study, list[Row]]]:
        """Return the other studies whose rows are all in the file, for the index."""
        others, old = [one for one in chosen((), ()) if one not in studies], whole_rows(self._path)
        found = []
        for module, study in others:
            own = [row for row in old if row.get("study") == study.name]
            blocks = blocks_of(module, study, self.runs, self.seed) if own else []
            kept, missing = split(blocks, own)
            if kept and not missing:
                found.append((study, _in_order(kept, blocks)))
        return found

    def _rows(self, studies: Sequence[tuple[str, Study]]) -> list[Row]:
        """Return the rows of all blocks, those of the file and those that were missing in it."""
        blocks = [block for module, study in studies for block in blocks_of(module, study, self.runs, self.seed)]
        old = whole_rows(self._path)
        kept, missing = split(blocks, [] if self.fresh else old)
        wanted = {study.name for _, study in studies}
        good = [row for row in old if row.get("study") not in wanted] + kept
        if len(good) < len(old):  # rows of other code, runs or seeds would only be in the way
            write_rows(self._path, good)
        done = len(blocks) - len(missing)
        if done:
            print(f"{done} of {len(blocks)} blocks are kept from {self._path}; --fresh runs them again")
        file = RowFile(self._path, keep=True)
        kept += run_missing(run_block, mixed(missing), file, self.processes, _at_hand, done=done)
        return _in_order(kept, blocks)


def _at_hand(row: Row) -> str:
    return f"{row['study']} · {row['system']}"


def _in_order(rows: Sequence[Row], blocks: Sequence[Block]) -> list[Row]:
    """Return the rows in the order of the tables, however the processes ended."""
    place = {block[1:5]: index for index, block in enumerate(blocks)}
    keys = ("study", "setting", "number", "system")
    return sorted(rows, key=lambda row: (place[tuple(row[name] for name in keys)], row["run"]))
