"""Where motions conflict: the areas that bodies sweep, and the pairs of motions whose areas share a point."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.execute.motions import Arcs, Curves, Motion, Pose
from warehouse_env.kernel import inline, kernel
from warehouse_env.simulation.physics.geometry import Rectangle, rectangles_touch

MARGIN = 0.04  # [m] between bodies that may be under way at the same time
NONE = -1
_STEP, _TURN = 0.05, 0.04  # [m], [rad] between two poses of an arc

Body = tuple[float, float, float, float, float, float]  # x, y [m], cos, sin, half length, half width [m]
Area = tuple[list[Body], tuple[Body, Body]]  # rectangles that a motion sweeps; the bodies at its start and its end


class Motions(NamedTuple):
    """The P motions of all robots, as the plan orders them, and the R rectangles that they sweep."""

    robot: NDArray[np.int64]  # [P]
    leaves: NDArray[np.int64]  # [P], the last step of the plan before it
    previous: NDArray[np.int64]  # [P], the robot's motion before, -1: none
    following: NDArray[np.int64]  # [P], likewise the one after
    first: NDArray[np.int64]  # [P + 1], where its rectangles begin
    swept: NDArray[np.float64]  # [R, 6]
    rests: NDArray[np.float64]  # [P, 2, 6], the bodies at its start and its end
    box: NDArray[np.float64]  # [P, 4]: least and greatest x, least and greatest y [m]


class Areas:
    """What bodies sweep, each motion once."""

    def __init__(self, curves: Curves) -> None:
        self.curves, robot = curves, curves.robot
        self._far = math.hypot(max(robot.rear_reach, robot.front_overhang), robot.width / 2)
        self._known: dict[tuple[Pose, bytes], Area] = {}

    def of(self, motion: Motion) -> Area:
        """Return the rectangles that a motion sweeps, and the bodies at its start and its end."""
        key = motion.start, motion.arcs.tobytes()
        if key not in self._known:
            ends = motion.start, self.curves.end(motion.start, motion.arcs)
            self._known[key] = self._swept(motion), (self.body(ends[0]), self.body(ends[1]))
        return self._known[key]

    def body(self, pose: Pose, more: float = 0.0, ahead: float = 0.0) -> Body:
        """Return the body grown by half of MARGIN and `more` [m], and by `ahead` [m] at its front and its tail."""
        (x, y, heading), robot, grown = pose, self.curves.robot, MARGIN / 2 + more
        c, s, back = math.cos(heading), math.sin(heading), robot.rear_reach - robot.length / 2
        return x - back * c, y - back * s, c, s, robot.length / 2 + grown + ahead, robot.width / 2 + grown

    def _swept(self, motion: Motion) -> list[Body]:
        """Return rectangles that together contain the grown body at every pose of a motion."""
        found, pose, end = list[Body](), motion.start, self.curves.end
        for arc in motion.arcs:
            length, bend = abs(float(arc[0])), abs(math.tan(arc[1])) / self.curves.robot.wheelbase
            count = 1 if bend == 0.0 else math.ceil(length * max(1.0 / _STEP, bend / _TURN))
            part: Arcs = np.array([[arc[0] / count, arc[1]]])
            if bend == 0.0:
                found.append(self.body(end(pose, part / np.array([2.0, 1.0])), ahead=length / 2))
            for k in range(0 if bend == 0.0 else count + 1):
                found.append(self.body(pose, more=length / count * (1.0 + self._far * bend) / 2))
                pose = end(pose, part) if k < count else pose
            if bend == 0.0:
                pose = end(pose, part)
        return found


def collect(areas: Sequence[Area], ranked: Sequence[tuple[int, int, int]], of: list[list[int]]) -> Motions:
    """Return all motions; ranked: (leaves, robot, number among its own) of each; of: the numbers of each robot's."""
    first = np.cumsum([0, *(len(swept) for swept, _ in areas)])
    swept = np.array([body for bodies, _ in areas for body in bodies], np.float64).reshape(-1, 6)
    (x, y), (c, s, length, width) = swept[:, :2].T, np.abs(swept[:, 2:]).T
    half_x, half_y = length * c + width * s, length * s + width * c
    box = [edge.reduceat(at, first[:-1]) for edge, at in (
        (np.minimum, x - half_x), (np.maximum, x + half_x), (np.minimum, y - half_y), (np.maximum, y + half_y),
    )] if len(areas) else [np.empty(0)] * 4  # fmt: skip
    previous, following = np.full(len(ranked), NONE), np.full(len(ranked), NONE)
    for numbers in of:
        previous[numbers[1:]], following[numbers[:-1]] = numbers[:-1], numbers[1:]
    steps, robots, _ = np.array(ranked, np.int64).reshape(-1, 3).T
    rests = np.array([ends for _, ends in areas], np.float64).reshape(-1, 2, 6)
    return Motions(robots, steps, previous, following, first, swept, rests, np.stack(box, axis=1))


@inline
def _touch(one, other):
    return rectangles_touch(
        Rectangle(one[0], one[1], one[2], one[3], one[4], one[5]),
        Rectangle(other[0], other[1], other[2], other[3], other[4], other[5]),
    )  # fmt: skip


@kernel
def _sweeps(a, body, motions):
    """Whether motion a sweeps over a body."""
    for k in range(motions.first[a], motions.first[a + 1]):  # noqa: SIM110 (kernels have no generators)
        if _touch(motions.swept[k], body):
            return True
    return False


@kernel
def sweeps_any(a, bodies, motions):
    """Whether motion a sweeps over one of several bodies."""
    for k in range(len(bodies)):  # noqa: SIM110
        if _sweeps(a, bodies[k], motions):
            return True
    return False


@kernel
def _conflicts(motions, order):
    """Return int64[C, 2]: all pairs of motions of two robots whose areas share a point, the earlier one first.

    order: the motions by the least x that they reach.
    """
    pairs, box, first = [(0, 0)], motions.box, motions.first
    for k in range(len(order)):
        one = order[k]
        for m in range(k + 1, len(order)):
            other = order[m]
            if box[other, 0] > box[one, 1]:
                break
            if motions.robot[one] == motions.robot[other] or box[one, 2] > box[other, 3] or box[other, 2] > box[one, 3]:
                continue
            a, b = min(one, other), max(one, other)
            if sweeps_any(a, motions.swept[first[b] : first[b + 1]], motions):
                pairs.append((a, b))
    return np.array(pairs)[1:]


@kernel
def swept_rests(pairs, motions):
    """Return bool[C, 4]: whether the first motion sweeps over the start, the end of the second; and the reverse."""
    found = np.zeros((len(pairs), 4), np.bool_)
    for k in range(len(pairs)):
        a, b = pairs[k]
        for end in range(2):
            found[k, end] = _sweeps(a, motions.rests[b, end], motions)
            found[k, 2 + end] = _sweeps(b, motions.rests[a, end], motions)
    return found


def conflicts(motions: Motions) -> NDArray[np.int64]:
    """Return int64[C, 2], sorted: all pairs of motions of two robots that conflict, the earlier one first."""
    pairs = _conflicts(motions, np.argsort(motions.box[:, 0], kind="stable"))
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])
