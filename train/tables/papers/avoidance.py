"""Paper 002's avoidance of an obstacle that the global plan does not hold, on the grid, and what else one could do.

The paper (discussion, and conclusion 2) lets the robot follow its global path, avoid what comes into its way by the
improved potential field, and plan the rest of the path again from where it then is. It prints no more. Read so: within
REACH of the obstacle the robot makes, each step, the legal move with the smallest angle to the force of eqs. 16-20; the
pull is to the cell of its path LOOK cells on, the push from the shelves (as in the paper's other table) and from the
obstacle; out of reach it plans again, if it has left its path, and follows. The robot knows where the obstacle is, not
where it goes, and the obstacle heeds nobody. Both make one move a step; they touch as in `coordinator`.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from train.reporting.rows import Row
from train.tables.papers.coordinator import TOUCH, Path, duration, nearest, path_of
from train.tables.study import System, TableTask
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning import Planner, make_planner, min_turns, path_length, turns
from warehouse_env.planning.field_walkers import along
from warehouse_env.planning.potential_field import force_at, intermediate_point, repulsion_parts

# d0 [cells] and k_rep of the obstacle. Of gains 1 to 60, reaches 2.5 to 6 and looks 4 to 12, tried on the maps 200 to
# 213, these avoid the most by the classical field, and within two points of the most by the improved one.
REACH, GAIN = 4.0, 60.0
SHELVES_GAIN, SHELVES_REACH = 0.3, 2.0  # as in the walkers' table
LOOK = 8  # [cells] along the path to what attracts
PATIENCE = 4  # times the steps of the path, after which a robot is given up


class Walked(NamedTuple):
    """A robot's cells with its waits, whether it came to its goal, and its least distance [cells] to the obstacle."""

    cells: Path
    arrived: bool
    apart: float


def obstacle_path(task: TableTask) -> Path:
    """Return the cells of the task's obstacle, one a step; after the last it stays. It drives a shortest path."""
    start, goal = task.others[0]
    return cells_of(make_planner("astar_turns"), task.grid, start, goal)


def cells_of(planner: Planner, grid: GridMap, start: Cell, goal: Cell) -> Path:
    """Return the cells of a plan; the planners used here draw nothing."""
    cells = planner.plan(grid, start, goal, np.random.default_rng(0)).cells
    return path_of(cells)


def avoid(task: TableTask, system: System, rng: np.random.Generator) -> Row:
    """Walk a task with what the system's mode does about its obstacle, and return the row's figures."""
    obstacle, optimum = obstacle_path(task), float(task.grid.distance_to(task.goal)[task.start])
    if system.mode == FORESIGHT:
        walked = _foreseen(task, obstacle)
    else:
        walked = _walk(Robot(task, system.make()), obstacle, MODES[system.mode])
    good = walked.arrived and walked.apart >= TOUCH
    kept = [cell for k, cell in enumerate(walked.cells) if k == 0 or cell != walked.cells[k - 1]]
    length = path_length(np.array(kept))
    return {
        "success": good, "length": length if good else None, "last": duration(walked.cells) if good else None,
        "contacts": float(walked.apart < TOUCH), "apart": walked.apart, "optimal_length": optimum,
        "gap": length / optimum - 1 if good else None, "turns": turns(np.array(kept)) if good else None,
        "min_turns": min_turns(task.grid, task.start, task.goal),
        "cells": [list(cell) for cell in kept] if good else None, "line": None,
    }  # fmt: skip


class Robot:
    """A robot on its way: where it is, and the global path from its first cell to the goal."""

    def __init__(self, task: TableTask, planner: Planner) -> None:
        self.grid, self.goal, self.at, self._planner = task.grid, task.goal, task.start, planner
        self.path = self.plan(self.grid)
        self.shelves = repulsion_parts(self.grid.occupied, SHELVES_GAIN, SHELVES_REACH)
        self.tried = np.zeros(self.grid.shape, np.bool_)  # intermediate points
        self.point: Cell | None = None

    def plan(self, grid: GridMap) -> Path:
        """Return a path from here to the goal, empty if there is none."""
        return cells_of(self._planner, grid, self.at, self.goal)

    def follow(self) -> Cell:
        """Return the next cell of the path; plans again where the robot has left it."""
        if self.at not in self.path:
            self.path = self.plan(self.grid)
        return self.path[min(self.path.index(self.at) + 1, len(self.path) - 1)]

    def ahead(self) -> Cell:
        """Return the cell LOOK cells on from the path's cell that is nearest to the robot, the last of several."""
        apart = [math.dist(cell, self.at) for cell in self.path]
        here = len(apart) - 1 - int(np.argmin(apart[::-1]))
        return self.path[min(here + LOOK, len(self.path) - 1)]

    def by_field(self, obstacle: Cell, target: Cell, exponent: float) -> Cell | None:
        """Return the cell to which the force to a target leads, None where it leads nowhere."""
        row, column = self.at
        d_row, d_column = row - obstacle[0], column - obstacle[1]
        distance = math.hypot(d_row, d_column)
        strength = GAIN * (1 / distance - 1 / REACH) / distance**3  # eq. 14; times the vector from the obstacle
        push, energy = self.shelves[0][row, column], self.shelves[1][row, column]
        energy = energy + 0.5 * GAIN * (1 / distance - 1 / REACH) ** 2
        pull = float(target[0] - row), float(target[1] - column)
        pushed = push[0] + strength * d_row, push[1] + strength * d_column
        move = along(self._free(obstacle), *force_at(*pull, *pushed, energy, 1.0, exponent))
        return None if move < 0 else (row + int(MOVES[move, 0]), column + int(MOVES[move, 1]))

    def _free(self, obstacle: Cell) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return bool[8], the legal moves but those onto the obstacle."""
        into = (MOVES + self.at == obstacle).all(axis=1)
        return np.asarray(self.grid.legal_moves[self.at] & ~into)


Mode = Callable[[Robot, Cell], Cell]
"""From the robot and an obstacle within REACH of it to the cell of the next step."""


def _heedless(robot: Robot, obstacle: Cell) -> Cell:
    return robot.follow()


def _wait(robot: Robot, obstacle: Cell) -> Cell:
    """Stand while the next cell is the obstacle's or one beside it."""
    to = robot.follow()
    beside = max(abs(to[0] - obstacle[0]), abs(to[1] - obstacle[1])) <= 1
    return robot.at if beside else to


def _new_route(robot: Robot, obstacle: Cell) -> Cell:
    """Plan around the obstacle and the cells beside it, in every step; around its own cell where there is no way."""
    for margin in (1, 0):
        occupied = robot.grid.occupied.copy()
        row, column = obstacle
        occupied[max(row - margin, 0) : row + margin + 1, max(column - margin, 0) : column + margin + 1] = True
        occupied[robot.at] = occupied[robot.goal] = False
        path = robot.plan(GridMap(occupied))
        if path:
            robot.path = path
            return robot.follow()
    return robot.at


def _field(exponent: float, points: bool) -> Mode:
    """Return the walk by the force, n = 0 the classical one; `points`: to an intermediate point where it is stuck."""

    def step(robot: Robot, obstacle: Cell) -> Cell:
        if robot.point == robot.at:
            robot.point = None
        to = robot.by_field(obstacle, robot.point or robot.ahead(), exponent)
        if to is None and points:
            occupied = robot.grid.occupied.copy()
            occupied[obstacle] = True
            point = intermediate_point(occupied, robot.at, robot.ahead(), robot.tried)
            if point[0] >= 0:
                robot.point = (int(point[0]), int(point[1]))
                robot.tried[robot.point] = True
                to = robot.by_field(obstacle, robot.point, exponent)
        return to or robot.at

    return step


FORESIGHT = "foresight"
MODES: dict[str, Mode] = {
    "heedless": _heedless,
    "wait": _wait,
    "new route": _new_route,
    "classical field": _field(0.0, False),
    "improved field": _field(1.0, False),
    "improved field, point": _field(1.0, True),
}


def _walk(robot: Robot, obstacle: Path, mode: Mode) -> Walked:
    """Walk until the goal, or until patience is over."""
    cells, apart = [robot.at], math.inf
    for step in range(PATIENCE * len(robot.path)):
        here, there = (obstacle[min(k, len(obstacle) - 1)] for k in (step, step + 1))
        near = 0.0 < math.dist(robot.at, here) < REACH
        if not near:
            robot.point = None
        to = mode(robot, here) if near else robot.follow()
        apart = min(apart, nearest(robot.at, to, here, there))
        robot.at = to
        cells.append(to)
        if to == robot.goal:
            return Walked(cells, True, apart)
    return Walked(cells, False, apart)


def _foreseen(task: TableTask, obstacle: Path) -> Walked:
    """Return the quickest way without touch for a robot that knows where the obstacle will be: A* on (cell, step)."""
    left, legal = task.grid.distance_to(task.goal), task.grid.legal_moves
    heap: list[tuple[float, float, int, Path]] = [(float(left[task.start]), 0.0, 0, [task.start])]
    closed: set[tuple[Cell, int]] = set()
    while heap:
        _, driven, step, cells = heapq.heappop(heap)
        at = cells[-1]
        if at == task.goal:
            stays = (obstacle + [obstacle[-1]] * len(cells))[: len(cells)]
            steps = zip(itertools.pairwise(cells), itertools.pairwise(stays), strict=True)
            return Walked(cells, True, min(nearest(*own, *other) for own, other in steps))
        if (at, step) in closed:
            continue
        closed.add((at, step))
        here, there = (obstacle[min(k, len(obstacle) - 1)] for k in (step, step + 1))
        for to in path_of([at, *(MOVES[legal[at]] + at)]):
            if nearest(at, to, here, there) >= TOUCH:
                cost = driven + max(1.0, math.dist(at, to))
                heapq.heappush(heap, (cost + float(left[to]), cost, step + 1, [*cells, to]))
    return Walked([task.start], False, math.inf)
