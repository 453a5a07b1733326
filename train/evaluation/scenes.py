"""Scenes for films: small floors with symmetric tasks, which deadlock robots that only avoid each other.

A scene is a floor and a function that draws starts and goals, jittered by the seed. Each robot has one goal (one-shot),
and no goal lies in another robot's way. A new scene is a line in SCENES.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.simulation.tasks.assignment import Assignment

ACROSS, TURN = 0.05, 0.05  # [m] that a start may be off across its way, [rad] in heading

Draw = Callable[[np.random.Generator], Assignment]
Starts = list[tuple[float, float, float]]  # row and column [cells], broken numbers too; heading [rad]


@dataclass(frozen=True, eq=False)
class SymmetricScene:
    """A floor, how many robots, and what draws their starts and goals."""

    grid: GridMap
    robots: int
    draw: Draw


def _floor(occupied: NDArray[np.bool_], name: str) -> GridMap:
    """Return a floor of shelves bool[H, W]; any free cell may be an endpoint."""
    free = np.argwhere(~occupied)
    return GridMap(occupied, picks=free[::2], stations=free[1::2], name=name)


def _jittered(
    grid: GridMap, starts: Starts, goals: list[Cell], most_along: float, rng: np.random.Generator
) -> Assignment:
    """Return the starts, each shifted a little, along its way by at most `most_along` [m], and the goals."""
    where = np.array(starts)
    pose = np.concatenate([grid.centre(where[:, :2]), where[:, 2:]], axis=1)
    along, across, turn = (rng.uniform(-most, most, len(pose)) for most in (most_along, ACROSS, TURN))
    ux, uy = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    pose += np.stack([along * ux - across * uy, along * uy + across * ux, turn], axis=1)
    return Assignment(pose, np.array(goals))


def head_on(lanes: int, passing_place: bool) -> SymmetricScene:
    """Two robots at the two ends of an aisle, each with its goal in the room at the other end.

    lanes: width of the aisle [cells], 16 long. passing_place: a bay, 4 cells long and 1 deep, off its middle.
    The rooms are 6 x 7 cells; robots start just inside the aisle, and the goals lie in corners of the rooms.
    """
    columns, room = 28, 6
    occupied = np.ones((7, columns), dtype=np.bool_)
    occupied[:, :room] = occupied[:, -room:] = occupied[3 : 3 + lanes] = False
    if passing_place:
        occupied[2, columns // 2 - 2 : columns // 2 + 2] = False
    grid = _floor(occupied, f"head_on_{lanes}")
    middle = 3 + (lanes - 1) / 2
    starts = [(middle, room + 2.0, 0.0), (middle, columns - room - 3.0, math.pi)]
    return SymmetricScene(grid, 2, partial(_jittered, grid, starts, [(1, columns - 2), (1, 1)], 1.0))


def crossing() -> SymmetricScene:
    """Four robots, one in each arm of a crossing of aisles two cells wide, each bound for the end of the arm ahead.

    Each arm is 8 cells long and ends in a room of 6 x 4 cells, in a corner of which the goal lies.
    """
    size, first = 26, 12  # the two lanes are rows and columns 12 and 13
    occupied = np.ones((size, size), dtype=np.bool_)
    lanes, rooms = slice(first, first + 2), slice(first - 2, first + 4)
    occupied[lanes] = occupied[:, lanes] = False
    for ends in (slice(4), slice(size - 4, size)):
        occupied[rooms, ends] = occupied[ends, rooms] = False
    grid = _floor(occupied, "crossing")
    middle, near, far = first + 0.5, 7.0, size - 8.0
    starts = [(middle, near, 0.0), (far, middle, math.pi / 2), (middle, far, math.pi), (near, middle, -math.pi / 2)]
    low, high, side = 1, size - 2, first - 2
    goals = [(side, high), (low, side), (side + 5, low), (high, side + 5)]
    return SymmetricScene(grid, 4, partial(_jittered, grid, starts, goals, 1.0))


def swap(robots: int) -> SymmetricScene:
    """Robots on a circle on open floor, facing its middle, each bound for the place opposite; 3 m of rim for each."""
    radius = max(3.5, 3.0 * robots / (2 * math.pi))
    side = 2 * math.ceil(radius) + 7
    grid = _floor(np.zeros((side, side), dtype=np.bool_), f"swap_{robots}")
    angles = 2 * math.pi * np.arange(robots) / robots
    middle = (side - 1) / 2
    rows, columns = middle - radius * np.sin(angles), middle + radius * np.cos(angles)
    starts = [(r, c, a + math.pi) for r, c, a in zip(rows, columns, angles, strict=True)]
    opposite = np.roll(np.arange(robots), -(robots // 2))
    goals = [(round(rows[k]), round(columns[k])) for k in opposite]
    return SymmetricScene(grid, robots, partial(_jittered, grid, starts, goals, 0.2))


SCENES: dict[str, Callable[[], SymmetricScene]] = {
    "head_on_passing_place": partial(head_on, 1, True),
    "head_on_two_cells": partial(head_on, 2, False),
    "crossing": crossing,
    **{f"swap_{robots}": partial(swap, robots) for robots in range(6, 21, 2)},
}
