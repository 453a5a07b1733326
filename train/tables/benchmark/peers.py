"""Public path planners, made to look like ours, so that the benchmark measures them on the same tasks.

None of them is needed: those that are not installed are left out. What can be prepared once for a map (a graph, a
matrix) is not in their times. Where a library has a choice, it is the one that suits a robot with a body: no diagonal
past a shelf's corner.
"""

from __future__ import annotations

import importlib
import importlib.util
import itertools
import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.base import BasePlanner
from warehouse_env.planning.plan import Plan

_ANT_STEPS = 400  # the most steps an ant of aco-routing may take; a parameter without a default there


@dataclass(frozen=True)
class Peer(BasePlanner):
    """A planner of another library. Errors that it raises for want of a path become an empty Plan."""

    package: ClassVar[str]  # as pip knows it
    needs: ClassVar[tuple[str, ...]]  # modules
    note: ClassVar[str]
    cuts_corners: ClassVar[bool] = False  # its diagonals pass shelf corners: another optimum
    most_pairs: ClassVar[int | None] = None  # of a map, where it is slow
    most_runs: ClassVar[int | None] = None  # of a pair

    @property
    def key(self) -> str:
        """Name and version."""
        return f"{self.package}=={metadata.version(self.package)}"

    def plan(self, grid: GridMap, *task: Any, **options: Any) -> Plan:
        """Prepare the map, which is not timed, and search."""
        self.ready(grid)
        return super().plan(grid, *task, **options)

    def find(
        self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: NDArray[np.float64] | None
    ) -> Plan:
        """Search."""
        try:
            cells = self.search(self.ready(grid), start, goal, rng)
        except Exception:  # a peer may raise anything; what matters here is that it gave no path
            cells = ()
        return Plan(np.array(cells, dtype=np.int64).reshape(-1, 2))

    def ready(self, grid: GridMap) -> Any:
        """Return what `search` takes for this map, prepared the first time it is asked for."""
        return _prepared(self.prepare, grid)

    @staticmethod
    def prepare(grid: GridMap) -> Any:
        """Prepare what `search` takes for this map."""
        raise NotImplementedError

    def search(self, prepared: Any, start: Cell, goal: Cell, rng: np.random.Generator) -> Sequence[Sequence[int]]:
        """Return the cells of a path, none where there is none."""
        raise NotImplementedError


@cache
def _prepared(prepare: Callable[[GridMap], Any], grid: GridMap) -> Any:
    return prepare(grid)


class Pathfinding(Peer):
    """A* of python-pathfinding."""

    name = package = "pathfinding"
    needs = ("pathfinding",)
    note = "A* in Python; diagonals only where both neighbours are free"

    @staticmethod
    def prepare(grid: GridMap) -> Any:
        """Return its grid of nodes."""
        return importlib.import_module("pathfinding.core.grid").Grid(matrix=(~grid.occupied).astype(int).tolist())

    def search(self, prepared: Any, start: Cell, goal: Cell, rng: np.random.Generator) -> Sequence[Sequence[int]]:
        """Search; its nodes are (x, y)."""
        mode = importlib.import_module("pathfinding.core.diagonal_movement").DiagonalMovement.only_when_no_obstacle
        finder = importlib.import_module("pathfinding.finder.a_star").AStarFinder(diagonal_movement=mode)
        prepared.cleanup()
        nodes, _ = finder.find_path(prepared.node(start[1], start[0]), prepared.node(goal[1], goal[0]), prepared)
        return [(node.y, node.x) for node in nodes]


class PyAStar2D(Peer):
    """A* of pyastar2d."""

    name = package = "pyastar2d"
    needs = ("pyastar2d",)
    note = "A* in C++; cuts shelf corners, and a diagonal costs 1 there: it minimises moves, not length"
    cuts_corners = True

    @staticmethod
    def prepare(grid: GridMap) -> Any:
        """Return the weights of the cells."""
        return np.where(grid.occupied, np.inf, 1.0).astype(np.float32)

    def search(self, prepared: Any, start: Cell, goal: Cell, rng: np.random.Generator) -> Sequence[Sequence[int]]:
        """Search; there is no option against cutting corners."""
        path = importlib.import_module("pyastar2d").astar_path(prepared, start, goal, allow_diagonal=True)
        return [] if path is None else path.tolist()


class NetworkX(Peer):
    """A* of NetworkX on the graph of legal moves."""

    name = package = "networkx"
    needs = ("networkx",)
    note = "astar_path in Python on our graph of legal moves, octile heuristic"

    @staticmethod
    def prepare(grid: GridMap) -> Any:
        """Return the graph."""
        return _graph(grid, lambda cell: cell, "weight")

    def search(self, prepared: Any, start: Cell, goal: Cell, rng: np.random.Generator) -> Sequence[Sequence[int]]:
        """Search."""
        return list(importlib.import_module("networkx").astar_path(prepared, start, goal, heuristic=_octile))


class AcoRouting(Peer):
    """The ant colony of aco-routing, with as many ants and iterations as ours."""

    name = package = "aco-routing"
    needs = ("aco_routing", "networkx", "matplotlib")
    note = f"ants in Python, 50 x 100, at most {_ANT_STEPS} steps, from the start; a greedy last ant gives the path"
    most_pairs = 10
    most_runs = 1

    @staticmethod
    def prepare(grid: GridMap) -> Any:
        """Return the graph; its nodes are texts."""
        return _graph(grid, _text, "cost")

    def search(self, prepared: Any, start: Cell, goal: Cell, rng: np.random.Generator) -> Sequence[Sequence[int]]:
        """Search; it draws from Python's own generator, which is put back after it."""
        state = random.getstate()
        random.seed(int(rng.integers(2**31)))
        try:
            colony = importlib.import_module("aco_routing").ACO(prepared, _ANT_STEPS, 100, ant_random_spawn=False)
            nodes, _ = colony.find_shortest_path(_text(start), _text(goal), 50)
        finally:
            random.setstate(state)
        return [tuple(map(int, node.split(","))) for node in nodes]


PEERS: dict[str, type[Peer]] = {peer.name: peer for peer in (Pathfinding, PyAStar2D, NetworkX, AcoRouting)}


def installed(peer: type[Peer]) -> bool:
    """Can the peer be imported here?"""
    return all(importlib.util.find_spec(module) is not None for module in peer.needs)


def missing_note() -> str:
    """Say which peers are not measured for want of their packages; empty where none is missing."""
    missing = [peer.package for peer in PEERS.values() if not installed(peer)]
    return f"Not installed, so not measured: {', '.join(missing)} (pip install {' '.join(missing)})." if missing else ""


def cutting_length(grid: GridMap, start: Cell, goal: Cell) -> float:
    """Length [cells] of the shortest path of a point that may graze shelf corners, the optimum of `cuts_corners`."""
    from warehouse_env.maps.distance import distance_field

    rows, columns = grid.shape
    free = np.pad(~grid.occupied, 1)
    entered = [free[1 + r : 1 + r + rows, 1 + c : 1 + c + columns] for r, c in MOVES.tolist()]
    legal = np.stack(entered, axis=-1) & ~grid.occupied[..., None]
    return float(distance_field(legal, MOVES, goal[0], goal[1])[start])


def _graph(grid: GridMap, node: Callable[[Cell], Any], weight: str) -> Any:
    """Return the directed graph of legal moves with their lengths; `node` names a cell."""
    graph = importlib.import_module("networkx").DiGraph()
    for row, column, move in np.argwhere(grid.legal_moves).tolist():
        d_row, d_column = MOVES[move].tolist()
        to = (row + d_row, column + d_column)
        graph.add_edge(node((row, column)), node(to), **{weight: math.hypot(d_row, d_column)})
    return graph


def _text(cell: Cell) -> str:
    return f"{cell[0]},{cell[1]}"


def _octile(a: Cell, b: Cell) -> float:
    d_row, d_column = abs(a[0] - b[0]), abs(a[1] - b[1])
    return max(d_row, d_column) + (math.sqrt(2.0) - 1.0) * min(d_row, d_column)


def touches_corner(grid: GridMap, cells: NDArray[np.int64]) -> bool:
    """Does a diagonal step of the path int64[L, 2] pass a shelf's corner?"""
    steps = itertools.pairwise(cells.tolist())
    return any(
        grid.occupied[row, to_column] or grid.occupied[to_row, column] for (row, column), (to_row, to_column) in steps
    )
