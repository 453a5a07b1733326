"""One-shot tasks that can all be done: no body parked at a goal cuts another robot off from its own goal.

A robot parks as soon as its front axle is within `arrival_radius` of its goal, at any heading. So whatever it does, its
body lies in a disc around the goal's centre; a body that drives along the grid's lines keeps off that disc on every
cell whose centre is half a body's width further out. Tasks are well-formed if each robot's start and goal are joined
by eq. 26 moves over free cells that the discs of all others leave (its own goal's disc does not count, for it lies
empty until the robot is there). This is the condition of well-formed infrastructures (Cap, Novak, Kleiner & Selecky
2015) for goals alone, checked exactly on the grid, for the worst parking pose of everybody at once. In any order of
arrivals a robot alone on the floor could then still drive to its goal.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import inline, kernel
from warehouse_env.maps.distance import label_regions
from warehouse_env.maps.grid_map import MOVES, GridMap

MARGIN = 0.05  # [m] between a passing body and the disc of a parked one


def body_reach(config: EnvConfig) -> float:
    """Return how far [m] from the front axle a body reaches at most."""
    robot = config.widest_body
    return math.hypot(max(robot.rear_reach, robot.front_overhang), robot.width / 2)


def disc_of(config: EnvConfig, cell: float) -> NDArray[np.int64]:
    """Return int64[K, 2]: where (row, column), from a goal's cell, a parked body may bar a cell of `cell` [m]."""
    off = config.pose_radius if config.arrival == "pose" else config.arrival_radius
    reach = (off + body_reach(config) + config.widest_body.width / 2 + MARGIN) / cell
    steps = np.arange(-math.floor(reach), math.floor(reach) + 1)
    offsets = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    within: NDArray[np.int64] = offsets[(offsets**2).sum(axis=1) < reach * reach]
    return within


class Barred(NamedTuple):
    """A floor with bodies parked at all goals."""

    free: Any  # bool[H, W]
    bars: Any  # int32[H, W], by how many bodies a cell is barred
    own: Any  # int32[H, W], the last robot, from 1, whose body bars a cell


class Reached(NamedTuple):
    """What robots get to."""

    label: Any  # int32[H, W], the regions, from 1, that all bodies leave, 0 elsewhere
    cells: Any  # int32[H, W], the last robot that reached a cell
    regions: Any  # int32[regions + 1], the last robot that reached a region


@inline
def _is_free(floor, mark, row, column):
    """Whether a cell is on the floor, free, and barred by nobody but robot `mark` itself, where own[cell] == mark."""
    free, bars, own = floor
    if row < 0 or column < 0 or row >= free.shape[0] or column >= free.shape[1] or not free[row, column]:
        return False
    return bars[row, column] == (1 if own[row, column] == mark else 0)


@kernel
def _joined(floor, reached, mark, start, goal, disc):
    """Whether robot `mark` gets from start to goal (row, column).

    Within its own disc the robot's way is grown cell by cell from the goal, and outside it region by region.
    """
    label, seen, met = reached
    if not _is_free(floor, mark, start[0], start[1]):
        return False
    if not _is_free(floor, mark, goal[0], goal[1]):
        return False
    seen[goal[0], goal[1]] = mark
    grown = True
    while grown:
        grown = False
        for d in range(len(disc)):
            row, column = goal[0] + disc[d, 0], goal[1] + disc[d, 1]
            if not _is_free(floor, mark, row, column):
                continue
            for m in range(8):
                r, c = row + MOVES[m, 0], column + MOVES[m, 1]
                if not _is_free(floor, mark, r, c):
                    continue
                if m % 2 == 1 and not _is_free(floor, mark, row, c):
                    continue
                if m % 2 == 1 and not _is_free(floor, mark, r, column):
                    continue
                region = label[r, c]
                there = met[region] == mark if region > 0 else seen[r, c] == mark
                if there == (seen[row, column] == mark):
                    continue
                grown = True
                seen[row, column] = mark
                if region > 0:
                    met[region] = mark
                else:
                    seen[r, c] = mark
    region = label[start[0], start[1]]
    return met[region] == mark if region > 0 else seen[start[0], start[1]] == mark


@kernel
def _cover(bars, own, goal, disc, mark):
    """Count the disc around a goal into bars int32[H, W], or where mark > 0 write it into own int32[H, W] instead."""
    for d in range(len(disc)):
        row, column = goal[0] + disc[d, 0], goal[1] + disc[d, 1]
        if 0 <= row < bars.shape[0] and 0 <= column < bars.shape[1]:
            if mark > 0:
                own[row, column] = mark
            else:
                bars[row, column] += 1


@kernel
def _cut_off(free, starts, goals, disc, out):
    """Write into out bool[N]; see cut_off."""
    bars, own, seen = np.zeros(free.shape, np.int32), np.zeros(free.shape, np.int32), np.zeros(free.shape, np.int32)
    for k in range(len(goals)):
        _cover(bars, own, goals[k], disc, 0)
    label = label_regions(free & (bars == 0))
    floor, reached = Barred(free, bars, own), Reached(label, seen, np.zeros(label.max() + 1, np.int32))
    for k in range(len(goals)):
        _cover(bars, own, goals[k], disc, k + 1)
        out[k] = not _joined(floor, reached, k + 1, starts[k], goals[k], disc)


def cut_off(
    grid: GridMap, starts: NDArray[np.int64], goals: NDArray[np.int64], disc: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return bool[N]: whose goal the bodies parked at the other goals part from its start; cells int64[N, 2].

    disc: see `disc_of`.
    """
    out = np.empty(len(goals), dtype=np.bool_)
    _cut_off(~grid.closed, starts, goals, disc, out)
    return out
