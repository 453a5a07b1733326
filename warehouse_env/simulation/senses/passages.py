"""Passages: aisles of one cell, where two robots that meet must back out, and the robots that drive along them.

Predictions follow motions for seconds; a robot that comes out of a passage may be farther. So each robot also knows how
far it may drive before it would meet one there: up to where the one-cell part of its route begins, which may be several
passages before. Robots in a passage tell those before it which way they go.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.driver.line import point_at, to_go
from warehouse_env.simulation.physics.floor import Floor, padded_cell
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.trigonometry import ZERO

FAR = np.float32(np.inf)
BEFORE = np.float32(1.4)  # [m] that a robot stops before a passage: robots that leave it turn there
_LOOK = np.float32(10.0)  # [m] of one-cell aisles that are looked ahead, from
_REACH = np.float32(2.4)  # [s] of driving away
_STEP = np.float32(0.5)  # [m] between the points of a route that are looked at
_WIDE, _JUNCTION = -1, -2
_FORWARDS, _BACKWARDS = 0, 1


class Passages(NamedTuple):
    """The passages of a floor, by its padded cells (see Floor.solid)."""

    numbers: NDArray[np.int32]  # [H + 2, W + 2]; where passages meet -2, elsewhere -1
    along: NDArray[np.float32]  # [H + 2, W + 2, 2], the way (x, y) forwards through each cell
    blind: NDArray[np.bool_]  # [P], whether one end is closed


def passages_of(floor: Floor) -> Passages:
    """Return the passages: chains of free cells that are in no free square of two cells by two."""
    from scipy.ndimage import binary_opening, label  # not when this is loaded, which takes long

    free = floor.solid == 0
    narrow = free & ~binary_opening(free, np.ones((2, 2), np.bool_))
    doors = sum(np.roll(free, by, axis).astype(np.int64) for by, axis in ((-1, 0), (1, 0), (-1, 1), (1, 1)))
    numbers, count = label(narrow & (doors <= 2))
    along, blind = np.zeros((*free.shape, 2), np.float32), np.zeros(count, np.bool_)
    for number in range(count):
        chain = _in_order([(row, column) for row, column in np.argwhere(numbers == number + 1).tolist()])
        blind[number] = any(doors[cell] < 2 for cell in chain)
        for before, cell, after in zip([chain[0], *chain], chain, [*chain[1:], chain[-1]], strict=False):
            along[cell] = after[1] - before[1], after[0] - before[0]
        if len(chain) == 1:
            row, column = chain[0]
            along[row, column] = (1, 0) if free[row, column + 1] or free[row, column - 1] else (0, 1)
    return Passages(np.where(narrow & (numbers == 0), _JUNCTION, numbers - 1).astype(np.int32), along, blind)


def _in_order(cells: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the cells (row, column) of one chain from one end to the other, or once round."""
    left = set(cells)

    def next_to(cell: tuple[int, int]) -> list[tuple[int, int]]:
        row, column = cell
        return [at for at in ((row, column + 1), (row + 1, column), (row, column - 1), (row - 1, column)) if at in left]

    chain = [min(cells, key=lambda cell: len(next_to(cell)))]
    left.remove(chain[0])
    while ways := next_to(chain[-1]):
        chain.append(ways[0])
        left.remove(ways[0])
    return chain


@inline
def _inside(r, numbers, p):
    """Return the passage that a robot is in, _JUNCTION or _WIDE."""
    return numbers[padded_cell(r["motion"]["x"], r["motion"]["y"], p["cell"], numbers)]


@inline
def _passage_at(r, route, ahead, passages, p):
    """Return (the passage, _JUNCTION or _WIDE, whether the way leads forwards through it) `ahead` [m] on a route."""
    on_route = r["on_route"]
    at = on_route["position"] + ahead
    x, y, ux, uy = point_at(route, on_route["points"], on_route["spacing"], at, p["beyond"])
    row, column = padded_cell(x, y, p["cell"], passages.numbers)
    forwards = ux * passages.along[row, column, 0] + uy * passages.along[row, column, 1] > ZERO
    return passages.numbers[row, column], forwards


@inline
def count_passing(robots, routes, passages, p, coming):
    """Count the robots that drive through each passage, by their direction, or in a blind one in both.

    coming: int32[P, 2]; passages: None without predictions. Nobody hears of a silent robot.
    """
    if passages is None:
        return
    for k in range(coming.shape[0]):
        coming[k, _FORWARDS] = coming[k, _BACKWARDS] = 0
    for i in range(robots.shape[0]):
        r, inside = robots[i], _inside(robots[i], passages.numbers, p)
        drives = r["on_route"]["points"] >= 2 and r["task"]["alive"] != 0 and r["shield"]["silent"] == 0
        if inside >= 0 and drives:
            _, forwards = _passage_at(r, routes[i], ZERO, passages, p)
            coming[inside, _FORWARDS] += forwards or passages.blind[inside]
            coming[inside, _BACKWARDS] += passages.blind[inside] or not forwards


@inline
def _free_way(r, route, passages, p, coming):
    """Return how far [m] a robot may drive on its route before aisles in which it would meet another, or FAR."""
    end, inside, begin, ahead = min(to_go(r), _LOOK), _inside(r, passages.numbers, p), FAR, ZERO
    reach, narrow = p["max_speed"] * _REACH + BEFORE, inside != _WIDE
    while ahead <= end and min(begin, ahead) <= reach:
        passage, forwards = _passage_at(r, route, ahead, passages, p)
        if passage == _WIDE:
            begin, narrow = FAR, False
        elif not narrow:
            begin, narrow = ahead, True
        if passage >= 0 and passage != inside and coming[passage, _BACKWARDS if forwards else _FORWARDS] > 0:
            return min(begin, ahead) - BEFORE
        ahead += _STEP
    return FAR


@part
def write_free_ways(worlds, b, some, vehicles, passages, sights):
    """Write how far some robots of world b may drive on their routes before aisles in which they would meet another.

    some: (first, after the last); `sights.coming`: see count_passing.
    """
    (params, kinds), robots, routes = vehicles, worlds.robots[b], worlds.routes[b]
    for i in range(some[0], some[1]):
        sights.free_ways[i] = FAR
        if robots[i]["on_route"]["points"] >= 2:
            own = kind_of(i, params[0], kinds)
            sights.free_ways[i] = _free_way(robots[i], routes[i], passages, own, sights.coming)
