"""`warehouse tables benchmark`: every planner on 200 pairs of cells of five floors, ten times each -> one report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from train.evaluation.pictures import file_name
from train.reporting.report import Table, require_charts
from train.tables.benchmark.figures import NOTE, Summary, anytime_table, csv, overview, rank, summarise, table_of
from train.tables.benchmark.maps import MAPS, make_tasks
from train.tables.benchmark.peers import PEERS, installed, missing_note
from train.tables.benchmark.runs import MOMENTS, pairs_of, planner_of
from train.tables.options import StudyOptions
from warehouse_env.errors import ConfigError, unknown_name
from warehouse_env.files import write_text
from warehouse_env.planning import PLANNERS
from warehouse_env.planning.ants.system import AntSystem

_FAMILIES = {
    "exact search": ("dijkstra", "astar", "astar_turns"), "any-angle search": ("theta_star",),
    "potential field": ("apf", "apf_improved"), "swarm": ("pso", "afsa"),
}  # fmt: skip


@dataclass(frozen=True)
class Benchmark(StudyOptions):
    """Plan pairs of cells by every planner: gaps, failures, turns, clearance, time, and the gap as time goes by."""

    name = "benchmark"

    pairs: int = 200
    """Pairs of cells planned on each map."""
    runs: int = 10
    """Runs of a planner on a pair."""
    maps: tuple[str, ...] = tuple(MAPS)
    """Maps by name, or MovingAI .map files."""
    planner: tuple[str, ...] = ()
    """Planners, ours and other libraries' by name (all that are installed if left out)."""
    pictures: bool = True
    """Draw gap against time, the spread of gaps, and the gap as time goes by."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.ray is not None:
            raise ConfigError(f"--ray {self.ray} must be left out: what these tables are about is time")

    def run(self) -> None:
        """Run what is missing, then write tables, figures and pictures."""
        maps, planners = tuple(dict.fromkeys(self.maps)), self._planners()
        for name in maps:
            make_tasks(name, 1, self.seed)  # a wrong name or file is noticed before anything is run
        if self.pictures:
            require_charts()
        self.check_writable()
        begin = time.perf_counter()
        jobs = pairs_of(maps, planners, self.pairs, self.runs, self.seed)
        note = "" if self.planner else missing_note()
        if note:
            print(note)
        asked = {(job.map, job.planner, job.pair) for job in jobs}
        rows = self.rows_of(jobs, lambda row: (row.get("map"), row.get("planner"), row.get("pair")) in asked)
        self._report(summarise(rows), note)
        print(self.written(begin))

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

    def _report(self, summaries: Sequence[Summary], note: str) -> None:
        """Write README.md, figures.csv and the pictures."""
        maps = list(dict.fromkeys(one.map for one in summaries))
        tables: list[Table] = [overview(summaries)]
        for name in maps:
            tables += [table_of(name, summaries), anytime_table(name, summaries)]
        drawn = _draw(summaries, maps, self.folder) if self.pictures else []
        shown = "".join(f"![{path.stem}]({path.name})\n\n" for path in drawn)
        self.write("Every planner on the same pairs of cells", tables, f"{NOTE} {note}\n\n{shown}")
        write_text(self.folder / "figures.csv", csv(summaries))


def _draw(summaries: Sequence[Summary], maps: Sequence[str], folder: Path) -> list[Path]:
    from warehouse_env.render.gap_charts import Spread, gap_spreads
    from warehouse_env.render.planner_charts import Curve, Point, anytime, pareto

    files = [folder / f"{what}.png" for what in ("pareto", "gaps", "anytime")]
    points, spreads, curves = ({file_name(name): [] for name in maps} for _ in files)  # type: ignore[var-annotated]
    for one in sorted(summaries, key=rank):
        panel, kind = file_name(one.map), family(one.planner)
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


def family(planner: str) -> str:
    """Return the kind of a planner of PLANNERS, with parameters or without, or of a peer, in a word or two."""
    name = planner.partition(":")[0]
    made = PLANNERS.get(name)
    if isinstance(made, type) and issubclass(made, AntSystem):
        return "ant colony"
    ours = (family for family, names in _FAMILIES.items() if name in names)
    return "another library" if planner in PEERS else next(ours, "other")
