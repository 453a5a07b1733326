"""The k shortest paths by networkx (Yen 1971), the library's answer to "other routes, please"."""

from __future__ import annotations

import importlib
from functools import cache
from itertools import islice
from typing import Any

import numpy as np

from warehouse_env.errors import WarehouseError
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.traffic.conflicts import Route


def require_networkx() -> Any:
    """Return networkx; WarehouseError if it is not installed."""
    try:
        return importlib.import_module("networkx")
    except ImportError:
        raise WarehouseError('k shortest paths need networkx; pip install "warehouse-env[tables]"') from None


@cache
def _graph(grid: GridMap) -> Any:
    graph = require_networkx().Graph()
    for row, column in grid.free_cells.tolist():
        for move in np.flatnonzero(grid.legal_moves[row, column]).tolist():
            to = (row + int(MOVES[move, 0]), column + int(MOVES[move, 1]))
            graph.add_edge((row, column), to, length=2**0.5 if move % 2 else 1.0)
    return graph


def k_shortest(grid: GridMap, start: Cell, goal: Cell, k: int) -> list[Route]:
    """Return the k shortest simple paths int64[L, 2], the shortest first."""
    paths = require_networkx().shortest_simple_paths(_graph(grid), start, goal, weight="length")
    return [np.array(path, dtype=np.int64) for path in islice(paths, k)]
