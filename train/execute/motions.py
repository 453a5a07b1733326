"""From a robot's cells to motions that its body can drive: arcs between poses at which it may stand.

A robot stands with the middle of its body in the middle of a cell, heading along a row or a column, so robots in
different cells never touch. Between two such poses lies the quickest Reeds-Shepp curve that keeps off the shelves
(simulation/driver/shots.py): it drives on, backs, turns within one move, or turns smoothly over two and may then stand
halfway; where aisles are too narrow for a curve, that is a manoeuvre (manoeuvre.py). Dynamic programming chooses the
headings that make the whole path quickest.
"""

import itertools
import math
from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import PlanError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import Cell
from warehouse_env.routes.reeds_shepp import rolled
from warehouse_env.simulation.driver.bodies import SearchArea
from warehouse_env.simulation.driver.manoeuvre import ARCS, EXACTLY, TRIES, Query, put_goal, search
from warehouse_env.simulation.driver.scratch import MOST, SHOT, make_search_scratch
from warehouse_env.simulation.driver.shots import shoot
from warehouse_env.simulation.physics.geometry import pose_at
from warehouse_env.simulation.simulator import Simulator

DIRECTIONS = ((0, 1), (-1, 0), (0, -1), (1, 0))  # (row, column) of east, north, west, south: heading k * pi / 2
MARGIN = 0.02  # [m] that motions keep from shelves
_LONGEST = 30.0  # [s] of a curve
_MANOEUVRE = 15.0  # [s], more than most take
_AVOIDED = 20.0  # [s] that a choice to be avoided costs
_MISSED = 5e-3  # [m]

Pose = tuple[float, float, float]  # front axle x [m], y [m], heading [rad]
Arcs = NDArray[np.float32]  # [K, 2]: signed length [m], steering [rad]


class Choice(NamedTuple):
    """A curve along a path: from one of its cells, by number, to the next or the one after that, with headings."""

    first: int
    begins: int
    last: int
    ends: int


class Motion(NamedTuple):
    """A part of a path that a robot drives once it is allowed to, and at whose end it may stand."""

    leaves: int  # number of the path's cell that it leaves
    start: Pose
    arcs: Arcs
    choice: Choice  # that it is, or is half of


@kernel
def _curve(start, goal, setup, scratch, searches, arcs):
    """Write the quickest free curve between two poses into arcs float32[ARCS, 2]; return their number, and seconds.

    searches: whether it may be a manoeuvre where no curve is free. The number is -1 if nothing is found.
    """
    goals, nothing, pose = scratch.near[:1], scratch.bodies[:0], pose_at(start[0], start[1], start[2])
    put_goal(goals, 0, goal[0], goal[1], goal[2], np.float32(0.0))
    around = SearchArea(nothing, scratch.rooms[:0], nothing, setup.floor, setup.metrics[0], setup.params[0])
    margin, longest, steer = np.float32(MARGIN), np.float32(_LONGEST), np.float32(0.0)
    count, seconds = shoot(pose, steer, goals, margin, longest, around, arcs[:SHOT])
    if count >= 0 or not searches:
        return count, seconds
    query = Query(pose, steer, EXACTLY, goals, goals[:0], around, TRIES, MOST, scratch)
    return search(query, arcs, True)[0], np.float32(_MANOEUVRE)


class Curves:
    """The curves between the poses of a floor's cells, each made once."""

    def __init__(self, simulator: Simulator) -> None:
        """simulator: of the floor and of robots of one kind. PlanError if a body is longer than a cell."""
        self.grid, self.robot, self._setup = simulator.grid, simulator.config.robot, simulator.search_setup
        if self.robot.length + MARGIN > self.grid.cell_size:
            raise PlanError(
                f"a body of {self.robot.length:g} m does not fit into cells of {self.grid.cell_size:g} m, so it cannot "
                "drive a plan of cells; choose larger cells"
            )
        self._scratch = make_search_scratch(1)
        self._ahead = self.robot.rear_reach - self.robot.length / 2
        self._known: dict[tuple[Cell, int, Cell, int], tuple[Arcs, float]] = {}

    def pose(self, cell: Cell, heading: int) -> Pose:
        """Return the pose at which a robot stands in a cell, by the number of its heading."""
        (x, y), angle = self.grid.centre(np.array(cell)).tolist(), heading * math.pi / 2
        return x + self._ahead * math.cos(angle), y + self._ahead * math.sin(angle), angle

    def between(self, cell: Cell, heading: int, to: Cell, turned: int) -> tuple[Arcs, float]:
        """Return the arcs from one such pose to another, and their seconds; inf if there are none."""
        key = cell, heading, to, turned
        if key not in self._known:
            arcs, start, goal = np.zeros((ARCS, 2), np.float32), self.pose(cell, heading), self.pose(to, turned)
            begin, end = (tuple(map(np.float32, pose)) for pose in (start, goal))
            two_moves = abs(cell[0] - to[0]) + abs(cell[1] - to[1]) == 2
            count, seconds = _curve(begin, end, self._setup, self._scratch, two_moves, arcs)
            found = arcs[: max(count, 0)]
            missed = math.dist(self.end(start, found)[:2], goal[:2])  # long manoeuvres are cut off
            there = count >= 0 and missed < _MISSED
            self._known[key] = found, float(seconds) if there else math.inf
        return self._known[key]

    def end(self, pose: Pose, arcs: Arcs) -> Pose:
        """Return the pose at the end of some arcs."""
        for length, steer in arcs.tolist():
            pose = rolled(*pose, length, -math.tan(steer) / self.robot.wheelbase)
        return pose


def motions_of(cells: Sequence[Cell], curves: Curves, avoided: Collection[Choice] = ()) -> list[Motion]:
    """Return the quickest motions along a path of adjacent cells.

    avoided: choices to make only where there is no other. PlanError if the body cannot follow the path.
    """
    seconds = np.full((len(cells), 4), math.inf)
    seconds[0] = 0.0
    best: dict[tuple[int, int], Choice] = {}
    for last in range(1, len(cells)):
        for choice in _choices(cells, last):
            more = curves.between(cells[choice.first], choice.begins, cells[last], choice.ends)[1]
            arrives = seconds[choice.first, choice.begins] + more + (_AVOIDED if choice in avoided else 0.0)
            if arrives < seconds[last, choice.ends]:
                seconds[last, choice.ends], best[last, choice.ends] = arrives, choice
        if not np.isfinite(seconds[last]).any():
            raise PlanError(f"a body cannot drive from {cells[last - 1]} to {cells[last]} between the shelves")
    found: list[Motion] = []
    at = len(cells) - 1, int(seconds[-1].argmin())
    while at[0] > 0:
        choice = best[at]
        found[:0] = _parts(choice, cells, curves)
        at = choice.first, choice.begins
    return found


def _choices(cells: Sequence[Cell], last: int) -> Iterator[Choice]:
    """Yield all choices to reach a cell of a path."""
    way = _direction(cells[last - 1], cells[last])
    for begins, ends in itertools.product(range(4), repeat=2):
        if (begins - way) % 2 == 0 or (ends - way) % 2 == 0:
            yield Choice(last - 1, begins, last, ends)
    if last > 1 and (before := _direction(cells[last - 2], cells[last - 1])) % 2 != way % 2:
        yield Choice(last - 2, before, last, way)
        yield Choice(last - 2, (before + 2) % 4, last, (way + 2) % 4)


def _direction(cell: Cell, to: Cell) -> int:
    return DIRECTIONS.index((to[0] - cell[0], to[1] - cell[1]))


def _parts(choice: Choice, cells: Sequence[Cell], curves: Curves) -> Iterator[Motion]:
    """Yield the motions of a choice: one for each move."""
    arcs, _ = curves.between(cells[choice.first], choice.begins, cells[choice.last], choice.ends)
    pose = curves.pose(cells[choice.first], choice.begins)
    for leaves, part in enumerate([arcs] if choice.last - choice.first == 1 else _halves(arcs), start=choice.first):
        yield Motion(leaves, pose, part, choice)
        pose = curves.end(pose, part)


def _halves(arcs: Arcs) -> tuple[Arcs, Arcs]:
    """Cut arcs at half of their length."""
    ends = np.cumsum(np.abs(arcs[:, 0]))
    begins, half = ends - np.abs(arcs[:, 0]), ends[-1] / 2
    first = np.clip((half - begins) / (ends - begins), 0.0, 1.0)
    parts = [np.column_stack([arcs[:, 0] * share, arcs[:, 1]])[share > 0.0] for share in (first, 1.0 - first)]
    return parts[0].astype(np.float32), parts[1].astype(np.float32)
