"""One goal for each robot, drawn so that all can get there in any order of arrivals (well_formed.py)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.simulation.draws import TRIAL, Key, below
from warehouse_env.simulation.tasks.placement import GAP
from warehouse_env.simulation.tasks.tasks import Tasks
from warehouse_env.simulation.tasks.well_formed import body_reach, cut_off, disc_of

TRIALS = 400  # to draw goals anew for one that is cut off; none to some tens are the rule
NEAR = 8  # goals about a start or goal of which one is looked for that bars it


class OneShotTasks(Tasks):
    """Goals that are distinct, and well-formed wherever that can be had.

    Starts are endpoints far enough apart for bodies of any heading. Then robot after robot draws a goal whose disc of
    parking poses covers nobody else's start or goal; whoever is cut off all the same draws anew, and so does one that
    may bar it. On a floor too small for its robots some stay cut off after TRIALS of that: see `cut_off`.
    """

    def __init__(self, grid: GridMap, config: EnvConfig) -> None:
        super().__init__(grid, config)
        self._disc = disc_of(config, grid.cell_size)
        self._reach = int((self._disc**2).sum(axis=1).max())  # squared [cells]
        self._apart = (2 * body_reach(config) + float(GAP)) / grid.cell_size  # [cells] between starts
        self._starts: list[Cell] = []

    def starts(self, key: Key) -> list[Cell]:
        """Return all places, those first that are far enough from each other."""
        first: list[Cell] = []
        rest: list[Cell] = []
        for cell in super().starts(key):
            roomy = all(math.dist(cell, other) >= self._apart for other in first)
            (first if roomy else rest).append(cell)
        return first + rest

    def elsewhere(self, key: Key) -> list[Cell]:
        """Return none: goals are well-formed for starts on places."""
        return []

    def first_goals(self, starts: Sequence[Cell], key: Key) -> list[Cell]:
        """Draw goals, then anew for one that is cut off and one that may bar it, as long as no more are cut off."""
        self._starts = list(starts)
        for robot in range(len(starts)):
            self._redraw(robot, self._kinds[self._next_kind[robot]], key)
        lost = np.flatnonzero(self._cut_off())
        for trial in range(TRIALS):
            if not len(lost):
                break
            robot, before = int(lost[below(key, TRIAL, 0, trial, 0, len(lost))]), list(self._goals)
            near = self._neighbours(robot)
            for one in sorted({robot, int(near[below(key, TRIAL, 0, trial, 1, len(near))])}):
                self._redraw(one, self.places, key)
            cut_off = np.flatnonzero(self._cut_off())
            if len(cut_off) <= len(lost):
                lost = cut_off
            else:
                self._goals = before
                self._taken = {goal for goal in before if goal is not None}
        return [goal for goal in self._goals if goal is not None]

    def assign(self, starts: Sequence[Cell], goals: Sequence[Cell]) -> None:
        """Take these as the robots' starts and goals."""
        super().assign(starts, goals)
        self._starts = list(starts)

    def next_goal(self, robot: int, at: Cell, key: Key) -> Cell:
        """Give a goal to a robot whose start has become another."""
        self._starts[robot] = at
        return self._redraw(robot, self._kinds[self._next_kind[robot]], key)

    def cut_off(self) -> float:
        """Return how many robots others parked at their goals could cut off from theirs; nan before the first reset."""
        return math.nan if None in self._goals else float(self._cut_off().sum())

    def _redraw(self, robot: int, wanted: list[Cell], key: Key) -> Cell:
        """Give a robot another goal, a wanted one if its disc can cover no other start or goal, else any free one."""
        old, self._goals[robot] = self._goals[robot], None
        self._drawn[robot] += 1
        if old is not None:
            self._taken.discard(old)
        start, others = self._starts[robot], self._others(robot)
        for cells in (wanted, self.places):
            roomy = [cell for cell in self._apart_from(cells, others) if cell != start]
            if roomy:
                goal = self._one_of(roomy, robot, 0, key)
                break
        else:
            goal = self._draw(self.places, robot, start, key) or start
        self._taken.add(goal)
        self._goals[robot] = goal
        return goal

    def _neighbours(self, robot: int) -> NDArray[np.int64]:
        """Return int64[K]: the robots whose goals lie nearest to a robot's start or goal, and so may bar it."""
        own = np.array([self._starts[robot], self._goals[robot]], dtype=np.int64)
        goals = np.array(self._goals, dtype=np.int64)
        squared = ((goals[:, None] - own[None]) ** 2).sum(axis=2).min(axis=1)
        squared[robot] = squared.max() + 1
        return np.argsort(squared, kind="stable")[:NEAR]

    def _others(self, robot: int) -> NDArray[np.int64]:
        """Return int64[K, 2], the starts and goals of all other robots."""
        starts = [cell for k, cell in enumerate(self._starts) if k != robot]
        return np.array([*starts, *(goal for goal in self._goals if goal is not None)], dtype=np.int64).reshape(-1, 2)

    def _cut_off(self) -> NDArray[np.bool_]:
        starts = np.array(self._starts, dtype=np.int64)
        return cut_off(self._grid, starts, np.array(self._goals, dtype=np.int64), self._disc)

    def _apart_from(self, cells: Sequence[Cell], others: NDArray[np.int64]) -> list[Cell]:
        """Return those of `cells` at which a parked body bars none of `others` int64[K, 2]."""
        if not len(others):
            return list(cells)
        apart = (np.array(cells)[:, None] - others[None]) ** 2
        distances = apart.sum(axis=2).min(axis=1).tolist()
        return [cell for cell, squared in zip(cells, distances, strict=True) if squared > self._reach]
