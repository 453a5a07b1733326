"""Theta*: its sight against exact geometry, its lines against the visibility graph of small maps, its cells by hand."""

from __future__ import annotations

import itertools
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import validate
from warehouse_env.planning.any_angle import ThetaStar, line_of_sight
from warehouse_env.planning.plan import Plan, validate_line

RNG = np.random.default_rng(0)


def plan(grid: GridMap, start: Cell, goal: Cell) -> Plan:
    return ThetaStar().plan(grid, start, goal, RNG)


def touches(a: Cell, b: Cell, square: Cell) -> bool:
    """Does the segment between two cell centres meet the closed unit square of a cell? Exact, by separating axes."""
    (r, c), (r2, c2) = ((2 * (p[0] - square[0]), 2 * (p[1] - square[1])) for p in (a, b))  # the square is [-1, 1]^2
    if min(r, r2) > 1 or max(r, r2) < -1 or min(c, c2) > 1 or max(c, c2) < -1:
        return False
    sides = [(r2 - r) * (y - c) - (c2 - c) * (x - r) for x in (-1, 1) for y in (-1, 1)]
    return min(sides) <= 0 <= max(sides)


@given(st.data())
def test_sight_equals_exact_geometry(data: st.DataObject) -> None:
    rows, cols = data.draw(st.integers(1, 7)), data.draw(st.integers(1, 7))
    shelves = data.draw(st.sets(st.tuples(st.integers(0, rows - 1), st.integers(0, cols - 1)), max_size=6))
    occupied = np.zeros((rows, cols), dtype=bool)
    for cell in shelves:
        occupied[cell] = True
    free = [tuple(cell) for cell in np.argwhere(~occupied).tolist()]
    if not free:
        return
    a, b = data.draw(st.sampled_from(free)), data.draw(st.sampled_from(free))
    assert line_of_sight(occupied, np.zeros(occupied.shape, np.uint8), *a, *b) == (
        not any(touches(a, b, shelf) for shelf in shelves)
    )


def visibility_length(grid: GridMap, start: Cell, goal: Cell) -> float:
    """The shortest any-angle line between cell centres, by Dijkstra on all pairs that see each other."""
    cells = [tuple(cell) for cell in np.argwhere(~grid.occupied).tolist()]
    length = dict.fromkeys(cells, math.inf)
    length[start] = 0.0
    while cells:
        here = min(cells, key=length.__getitem__)
        cells.remove(here)
        for other in cells:
            if math.isfinite(length[here]) and line_of_sight(grid.occupied, grid.one_way, *here, *other):
                length[other] = min(length[other], length[here] + math.dist(here, other))
    return length[goal]


def test_lines_on_random_maps_lie_between_the_shortest_line_and_the_lattice() -> None:
    rng = np.random.default_rng(5)
    excess, saved = [], []
    for _ in range(60):
        occupied = rng.random((8, 10)) < rng.choice([0.1, 0.25, 0.4])
        occupied[0, 0] = occupied[7, 9] = False
        grid = GridMap(occupied)
        found = plan(grid, (0, 0), (7, 9))
        shortest, lattice = visibility_length(grid, (0, 0), (7, 9)), float(grid.distance_to((7, 9))[0, 0])
        assert found.found == math.isfinite(lattice) == math.isfinite(shortest)
        if not found.found:
            assert found.line is None
            continue
        assert found.line is not None
        validate_line(grid, found.line, (0, 0), (7, 9))
        vertices = found.line.astype(int).tolist()
        assert all(
            line_of_sight(occupied, np.zeros(occupied.shape, np.uint8), *a, *b) for a, b in itertools.pairwise(vertices)
        )
        assert shortest - 1e-9 <= found.line_length <= lattice + 1e-9
        validate(grid, found.cells, (0, 0), (7, 9))
        excess.append(found.line_length / shortest - 1)
        saved.append(lattice / shortest - 1)
    assert len(excess) > 30
    assert np.mean(excess) < 0.5 * np.mean(saved)  # most of what a line at any angle can save
