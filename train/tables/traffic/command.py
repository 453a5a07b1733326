"""`warehouse tables traffic`: what a colony can do that A* cannot, with several robots -> one report."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from train.evaluation.jobs import Job, Result, Tick
from train.reporting.report import Table, require_charts
from train.reporting.rows import Row, mean_interval, select, values_of
from train.tables.code import DRIVING, PLANNING, code_of
from train.tables.options import StudyOptions
from train.tables.traffic.driving import DRIVEN, DRIVEN_ROBOTS, measure_driving
from train.tables.traffic.figures import (
    alternatives_table,
    answers,
    conflicts_of,
    driving_table,
    replanning_table,
    routes_table,
)
from train.tables.traffic.jobs import MAPS, Piece, floor
from train.tables.traffic.replanning import measure_replanning
from train.tables.traffic.routes import PRICE, measure_routes, require_networkx
from warehouse_env import __version__
from warehouse_env.planning import make_planner
from warehouse_env.traffic.expected import endpoint_tasks
from warehouse_env.traffic.together import plan_together

CASES_A_DRAW = 2  # changed floors of each kind for every draw
EPISODES_A_DRAW = 3  # draws for every driven episode
_PARTS = {"routes": measure_routes, "replanning": measure_replanning, "driving": measure_driving}
_PICTURED = 32  # robots


@dataclass(frozen=True)
class Measurement(Job):
    """A piece of the study to be measured."""

    piece: Piece

    titled = "{piece.part} · {piece.map}"

    @property
    def identity(self) -> Row:
        """What its rows are known by."""
        part = self.piece.part
        code = code_of(f"train.tables.traffic.{part}", within=DRIVING if part == "driving" else PLANNING)
        return {"job": {**self.piece._asdict(), "version": __version__, "code": code}}

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Measurement | None]:
        """Return the rows, if there are as many as they say."""
        return (rows, None) if rows and len(rows) == rows[0].get("rows") else ([], self)

    def run(self, tick: Tick) -> Result:
        """Measure; every row has the identity, and says how many there are."""
        piece, identity = self.piece, self.identity
        about = {"part": piece.part, "map": piece.map, "number": piece.number, "robots": piece.robots}
        rows = [{**about, **row} for row in measured(piece)]
        return Result([{**row, "rows": len(rows), **identity} for row in rows])


def measured(piece: Piece) -> list[Row]:
    """Measure what a piece's part of the study asks for."""
    return list(_PARTS[piece.part](piece))


@dataclass(frozen=True)
class Traffic(StudyOptions):
    """Plan and drive routes of several robots: conflicts, choices of routes, replanning, what driving makes of it."""

    name = "traffic"

    runs: int = 30
    """Draws of tasks on each map."""
    maps: tuple[str, ...] = MAPS
    """Layouts."""
    driving: bool = True
    """Also drive in the simulator, two thirds of the time."""
    pictures: bool = True
    """Draw conflicts against length, and routes kept apart."""

    def run(self) -> None:
        """Run what is missing, then write tables, answers and pictures."""
        require_networkx()
        maps = tuple(dict.fromkeys(self.maps))
        for name in maps:
            floor(name)  # a wrong name is noticed before anything is run
        if self.pictures:
            require_charts()
        self.check_writable()
        begin = time.perf_counter()
        pieces = self.pieces(maps)
        asked, jobs = set(pieces), [Measurement(piece) for piece in pieces]
        rows = self.rows_of(jobs, lambda row: values_of(row.get("job", {}), Piece._fields) in asked)
        drawn = list(_draw(rows, maps, self.folder, self.seed)) if self.pictures else []
        shown = "".join(f"![{path.stem}]({path.name})\n\n" for path in drawn)
        self.write("What can a colony do that A* cannot?", report(rows, maps), shown)
        print(self.written(begin))

    def pieces(self, maps: Sequence[str]) -> list[Piece]:
        """Return all pieces of the study."""
        pieces = []
        for name in maps:
            pieces += [Piece("routes", name, number, self.seed) for number in range(self.runs)]
            pieces += [Piece("replanning", name, number, self.seed) for number in range(self.runs * CASES_A_DRAW)]
            pieces += [
                Piece("driving", name, number, self.seed, system, robots)
                for number in range(-(-self.runs // EPISODES_A_DRAW) if self.driving else 0)
                for robots in DRIVEN_ROBOTS
                for system in DRIVEN
            ]
        return pieces


def report(rows: Sequence[Row], maps: Sequence[str]) -> list[Table]:
    """Return all tables, the answers first."""
    tables = [answers(rows, maps), *(routes_table(name, rows) for name in maps)]
    tables += [alternatives_table(rows), replanning_table(rows)]
    return [*tables, driving_table(rows)] if select(rows, part="driving") else tables


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
