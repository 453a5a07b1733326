"""`warehouse tables --benchmark`: every planner on 200 pairs of cells of five floors, ten times each -> one report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from train.evaluation.pictures import file_name
from train.reporting.report import Table, require_charts
from train.reporting.rows import Row, RowFile, check_writable, whole_rows, write_rows, write_text
from train.tables.all_planners import family
from train.tables.benchmark.figures import NOTE, Summary, anytime_table, csv, overview, rank, summarise, table_of
from train.tables.benchmark.maps import MAPS, make_map, make_tasks
from train.tables.benchmark.peers import PEERS, Peer, installed, missing_note
from train.tables.benchmark.runs import (
    MOMENTS,
    Block,
    Watched,
    blocks_of,
    planner_of,
    run_block,
    sort_out,
    warm_up,
)
from train.tables.pieces import run_missing
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, unknown_name
from warehouse_env.planning import PLANNERS

RUNS = 10
_PEER_SECONDS = 8.0  # a plan of a peer that is too slow to be tried out before the start, for the estimate alone


@dataclass(frozen=True)
class Benchmark(Checked):
    """The benchmark beyond the papers: gaps, failures, turns, clearance, time, and the gap as time goes by."""

    out: Path = Path("results/tables")
    json: Path | None = None  # OUT/benchmark/rows.jsonl if None
    runs: int | None = None  # of a planner on a pair; RUNS if None
    seed: int = 0  # of the pairs and of the runs
    processes: int = 2
    fresh: bool = False  # run everything again, instead of keeping the rows that are there
    pictures: bool = True
    pairs: int = 200  # of each map
    maps: tuple[str, ...] = ()  # of MAPS, or MovingAI files; all of MAPS if empty
    planner: tuple[str, ...] = ()  # of PLANNERS, with parameters or without, and PEERS; all that are there if empty

    def run(self) -> None:
        """Run what is missing, then write tables, figures and pictures."""
        runs = RUNS if self.runs is None else self.runs
        for option, value, least in (("pairs", self.pairs, 1), ("runs", runs, 1), ("seed", self.seed, 0)):
            if value < least:
                raise ConfigError(f"--{option} {value} must be at least {least}")
        maps, planners = self._maps(), self._planners()
        if self.pictures:
            require_charts()
        folder = self.out / "benchmark"
        check_writable(folder / "README.md")
        blocks = blocks_of(maps, planners, self.pairs, runs, self.seed)
        note = "" if self.planner else missing_note()
        if note:
            print(note)
        rows = self._rows(blocks, self.json or folder / "rows.jsonl")
        written = write_report(summarise(rows), folder, self.pictures, note)
        print(f"wrote {written} files to {folder}; begin with README.md")

    def _maps(self) -> tuple[str, ...]:
        chosen = tuple(dict.fromkeys(self.maps)) or tuple(MAPS)
        for name in chosen:
            make_tasks(name, 1, self.seed)  # a wrong name or file is noticed before anything is run
        return chosen

    def _planners(self) -> tuple[str, ...]:
        for name in self.planner:
            kind = name.partition(":")[0]
            if kind not in PLANNERS and kind not in PEERS:
                raise unknown_name("planner", kind, [*PLANNERS, *PEERS])
            if name in PEERS and not installed(PEERS[name]):
                raise ConfigError(f"{name} is not installed; pip install {PEERS[name].package}")
            planner_of(name)  # a wrong parameter is noticed before anything is run
        peers = [name for name, peer in PEERS.items() if installed(peer)]
        return tuple(dict.fromkeys(self.planner)) or (*PLANNERS, *peers)

    def _rows(self, blocks: Sequence[Block], path: Path) -> list[Row]:
        """Return the rows of all blocks in their order, those of the file and those that were missing in it."""
        old = whole_rows(path)
        known = sort_out(blocks, [] if self.fresh else [row for row in old if "made" in row])
        if old:  # rows of other code or seeds would only be in the way
            chosen = {(block.map, block.planner, pair) for block in blocks for pair in range(block.first, block.last)}
            others = [row for row in old if (row.get("map"), row.get("planner"), row.get("pair")) not in chosen]
            write_rows(path, [*others, *known.rows])
        if known.rows:
            print(f"{len(known.rows)} rows are kept from {path}; --fresh runs everything again")
        seconds = estimate(known.missing)
        if known.missing:
            plans = sum((block.last - block.first) * block.runs for block in known.missing)
            hours = _time(sum(seconds) / self.processes)
            print(f"up to {plans} plans in {self.processes} processes, about {hours}; a stop loses a block at most")
        size = dict(zip(known.missing, seconds, strict=True)).__getitem__
        fresh = run_missing(run_block, known.missing, RowFile(path, keep=True), self.processes, _at_hand, size=size)
        return _in_order([*known.rows, *fresh], blocks)


def _at_hand(row: Row) -> str:
    return f"{row['map']} · {row['planner']}, seconds of work"


def _in_order(rows: Sequence[Row], blocks: Sequence[Block]) -> list[Row]:
    """Return the rows in the order of the options, however the processes ended."""
    maps = {name: place for place, name in enumerate(dict.fromkeys(block.map for block in blocks))}
    planners = {name: place for place, name in enumerate(dict.fromkeys(block.planner for block in blocks))}
    return sorted(rows, key=lambda row: (maps[row["map"]], planners[row["planner"]], row["pair"], row["run"]))


def estimate(blocks: Sequence[Block]) -> list[float]:
    """Return the seconds that each block may take, from one plan of every planner on a middling pair of every map."""
    a_plan: dict[tuple[str, str], float] = {}
    for block in blocks:
        key = (block.planner, block.map)
        if key not in a_plan:
            a_plan[key] = _one_plan(block)
    return [a_plan[b.planner, b.map] * (b.last - b.first) * b.runs for b in blocks]


def _one_plan(block: Block) -> float:
    """Return the seconds of a plan, divided by the runs where it draws no random number and stands for all."""
    planner = planner_of(block.planner)
    if isinstance(planner, Peer) and planner.most_pairs:
        return _PEER_SECONDS
    tasks = sorted(make_tasks(block.map, block.pairs, block.seed), key=lambda task: task.optimal_length)
    task = tasks[len(tasks) // 2]
    warm_up(block.planner, block.map, task)
    watched = Watched(block.seed)
    begin = time.perf_counter()
    planner.plan(make_map(block.map), task.start, task.goal, watched.rng)
    return (time.perf_counter() - begin) / (1 if watched.drawn else block.runs)


def _time(seconds: float) -> str:
    return f"{seconds / 60:.0f} minutes" if seconds > 90 else f"{seconds:.0f} s"


def write_report(summaries: Sequence[Summary], folder: Path, pictures: bool, note: str = "") -> int:
    """Write README.md, figures.csv and the pictures into a folder; return the number of files."""
    maps = list(dict.fromkeys(one.map for one in summaries))
    tables: list[Table] = [overview(summaries)]
    for name in maps:
        tables += [table_of(name, summaries), anytime_table(name, summaries)]
    for table in (*tables[1::2], tables[0]):
        table.print()
    drawn = _draw(summaries, maps, folder) if pictures else []
    shown = "".join(f"![{path.stem}]({path.name})\n\n" for path in drawn)
    first, *rest = (table.markdown() for table in tables)
    title = "# Every planner on the same pairs of cells"
    write_text(folder / "README.md", "\n".join([f"{title}\n\n{NOTE} {note}\n", first, shown, *rest]))
    write_text(folder / "figures.csv", csv(summaries))
    return 2 + len(drawn)


def _draw(summaries: Sequence[Summary], maps: Sequence[str], folder: Path) -> list[Path]:
    from warehouse_env.render.gap_charts import Spread, gap_spreads
    from warehouse_env.render.planner_charts import Curve, Point, anytime, pareto

    files = [folder / f"{what}.png" for what in ("pareto", "gaps", "anytime")]
    points, spreads, curves = ({file_name(name): [] for name in maps} for _ in files)  # type: ignore[var-annotated]
    for one in sorted(summaries, key=rank):
        panel, kind = file_name(one.map), _family(one.planner)
        gap, low, high = (100 * value for value in one.gap[:3])
        median, p95, p99, worst = (100 * value for value in one.quantiles)
        points[panel].append(Point(one.planner, kind, one.ms, gap, low, high, one.failed))
        spreads[panel].append(Spread(one.planner, gap, median, p95, p99, worst, one.failed))
        settled = np.where(one.arrived >= 0.95 * (1 - one.failed), 100 * one.anytime, np.nan)
        curves[panel].append(Curve(one.planner, kind, np.array(MOMENTS), settled))
    pareto(points, files[0], "Gap against time")
    gap_spreads(spreads, files[1], "How the gaps are spread")
    anytime(curves, files[2], "Mean gap of the best path so far, once 95% of the runs have one")
    return files


def _family(planner: str) -> str:
    return "another library" if planner in PEERS else family(planner.partition(":")[0])
