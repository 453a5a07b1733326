"""`warehouse tables --traffic`: what a colony can do that A* cannot, with several robots -> one report."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from train.reporting.report import require_charts
from train.reporting.rows import Row, RowFile, check_writable, mean_interval, select, whole_rows, write_rows, write_text
from train.tables.pieces import run_missing
from train.tables.traffic.driving import DRIVEN, DRIVEN_ROBOTS, measure_driving
from train.tables.traffic.figures import (
    alternatives_table,
    answers,
    conflicts_of,
    driving_table,
    replanning_table,
    routes_table,
)
from train.tables.traffic.jobs import MAPS, Job, floor
from train.tables.traffic.k_shortest import require_networkx
from train.tables.traffic.replanning import measure_replanning
from train.tables.traffic.routes import PRICE, measure_routes
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError
from warehouse_env.planning import make_planner
from warehouse_env.traffic.expected import endpoint_tasks
from warehouse_env.traffic.together import plan_together

DRAWS = 30  # of tasks on each map
CASES_A_DRAW = 2  # changed floors of each kind for every draw
EPISODES_A_DRAW = 3  # draws for every driven episode
_PARTS = {"routes": measure_routes, "replanning": measure_replanning, "driving": measure_driving}
_PICTURED = 32  # robots


@dataclass(frozen=True)
class Traffic(Checked):
    """Routes of several robots: conflicts, alternatives, planning again, and what is left of it when driven."""

    out: Path = Path("results/tables")
    json: Path | None = None  # OUT/traffic/rows.jsonl if None
    runs: int | None = None  # draws of tasks on each map; DRAWS if None
    seed: int = 0
    processes: int = 2
    fresh: bool = False  # run everything again, instead of keeping the rows that are there
    pictures: bool = True
    maps: tuple[str, ...] = ()  # names of layouts; MAPS if empty
    driving: bool = True  # also drive in the simulator, two thirds of the time

    def run(self) -> None:
        """Run what is missing, then write tables, answers and pictures."""
        draws = DRAWS if self.runs is None else self.runs
        if draws < 1 or self.seed < 0:
            raise ConfigError(f"--runs {draws} must be at least 1 and --seed {self.seed} at least 0")
        require_networkx()
        maps = tuple(dict.fromkeys(self.maps)) or MAPS
        for name in maps:
            floor(name)  # a wrong name is noticed before anything is run
        if self.pictures:
            require_charts()
        folder = self.out / "traffic"
        check_writable(folder / "README.md")
        begin = time.perf_counter()
        jobs = self.jobs(draws, maps)
        rows = self._rows(jobs, self.json or folder / "rows.jsonl")
        written = write_report(rows, maps, folder, self.pictures, self.seed)
        print(f"wrote {written} files to {folder} in {time.perf_counter() - begin:.0f} s; begin with README.md")

    def jobs(self, draws: int, maps: Sequence[str]) -> list[Job]:
        """Return all pieces of work; the first ones of every part and map come first."""
        jobs = []
        for number in range(draws * CASES_A_DRAW):
            for name in maps:
                if number < draws:
                    jobs.append(Job("routes", name, number, self.seed))
                jobs.append(Job("replanning", name, number, self.seed))
                if self.driving and number < -(-draws // EPISODES_A_DRAW):
                    jobs += [
                        Job("driving", name, number, self.seed, system, robots)
                        for robots in DRIVEN_ROBOTS
                        for system in DRIVEN
                    ]
        return jobs

    def _rows(self, jobs: Sequence[Job], path: Path) -> list[Row]:
        """Return the rows of all jobs in their order, those of the file and those that were missing in it."""
        wanted = {_key(job.identity): job for job in jobs}
        asked = {_key(job._asdict()) for job in jobs}
        known: dict[str, list[Row]] = {}
        others = []
        for row in whole_rows(path):
            made = row.get("job", {})
            if not self.fresh and _key(made) in wanted:
                known.setdefault(_key(made), []).append(row)
            elif _key({name: made.get(name) for name in Job._fields}) not in asked:  # else of other code: in the way
                others.append(row)
        known = {key: own for key, own in known.items() if len(own) == own[0].get("rows")}  # a stop may tear a piece
        if known:
            print(f"{len(known)} of {len(jobs)} pieces are kept from {path}; --fresh runs them again")
        write_rows(path, [*others, *(row for own in known.values() for row in own)])
        missing = [job for key, job in wanted.items() if key not in known]
        file = RowFile(path, keep=True)
        for row in run_missing(run_job, missing, file, self.processes, _at_hand, done=len(known)):
            known.setdefault(_key(row["job"]), []).append(row)
        return [row for key in wanted for row in known[key]]


def _at_hand(row: Row) -> str:
    return f"{row['part']} · {row['map']}"


def _key(identity: Row) -> str:
    """Return a piece's identity as text."""
    return json.dumps(identity, sort_keys=True)


def run_job(job: Job) -> list[Row]:
    """Do a piece of work; every row carries the job's identity as `job`, and how many rows there are of it."""
    about = {"part": job.part, "map": job.map, "number": job.number, "robots": job.robots}
    rows = measured(job)
    return [{**about, **row, "rows": len(rows), "job": job.identity} for row in rows]


def measured(job: Job) -> list[Row]:
    """Measure what the job's part of the study asks for."""
    return list(_PARTS[job.part](job))


def write_report(rows: Sequence[Row], maps: Sequence[str], folder: Path, pictures: bool, seed: int) -> int:
    """Write README.md, a CSV file and the pictures into a folder; return the number of files."""
    tables = [answers(rows, maps), *(routes_table(name, rows) for name in maps)]
    tables += [alternatives_table(rows), replanning_table(rows)]
    if select(rows, part="driving"):
        tables.append(driving_table(rows))
    for table in tables:
        table.print()
    drawn = list(_draw(rows, maps, folder, seed)) if pictures else []
    shown = "".join(f"![{path.stem}]({path.name})\n\n" for path in drawn)
    text = "\n".join(table.markdown() for table in tables)
    write_text(folder / "README.md", f"# What can a colony do that A* cannot?\n\n{shown}{text}")
    return 1 + len(drawn)


def _draw(rows: Sequence[Row], maps: Sequence[str], folder: Path, seed: int) -> Iterator[Path]:
    from warehouse_env.render.traffic_charts import Trade, opposing_streets, trades

    panels: dict[str, list[Trade]] = {}
    for name in maps:
        own = [row for row in rows if row["part"] == "routes" and row["map"] == name and row["robots"] == _PICTURED]
        for system in dict.fromkeys(row["system"] for row in own):
            for price in sorted({row["price"] for row in own if row["system"] == system}):
                group = select(own, system=system, price=price)
                met, paid = mean_interval(map(conflicts_of, group)), mean_interval(100 * row["paid"] for row in group)
                panels.setdefault(name, []).append(Trade(system, price, paid.mean, met.mean, met.low, met.high))
    yield folder / "trade.png"
    trades(panels, folder / "trade.png", f"Conflicts against length, {_PICTURED} robots", PRICE)
    grid, astar = floor(maps[0]), make_planner("astar")
    tasks = endpoint_tasks(grid, _PICTURED, np.random.default_rng([seed, 0]))
    alone = [astar.plan(grid, *task, np.random.default_rng(0)).cells for task in tasks]
    around = [plan.cells for plan in plan_together(astar, grid, tasks, seed, price=PRICE)]
    yield folder / "streets.png"
    opposing_streets(grid, {"astar": alone, "astar, cost a move": around}, folder / "streets.png")
