"""The arcs that robots drive between the states of a solution, and the faults of each arc by itself."""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.clmapf.instance import BODY, Instance, States

TOLERANCE = 0.01  # of given poses, lengths and turns: the authors' files have six digits
AUTHORS_STEP = 2.118  # seconds of a step of the authors' solver: radius 3 times 0.706 rad
BEGIN, END, X, Y, HEADING, LENGTH, BEND = range(7)  # columns of motions float64[M, 7]; LENGTH is negative in reverse
_CORNERS = tuple((ahead, left) for ahead in (BODY.ahead, -BODY.behind) for left in (BODY.half_width, -BODY.half_width))
_STILL = 1e-12  # [rad] up to which there is no turn


class Fault(NamedTuple):
    """A fault of a solution."""

    kind: str
    robot: str
    other: str  # another robot, an obstacle's number, or nothing
    time: float  # [s]
    size: float  # depth of an overlap, or excess over a limit

    def __str__(self) -> str:
        other = f" {self.other}" if self.other else ""
        return f"at {self.time:.3f} {self.robot}: {self.kind}{other} by {self.size:.4g}"


class Motions(NamedTuple):
    """The arcs of all robots in turn; a robot stands before and after its own."""

    arcs: NDArray[np.float64]  # [M, 7]
    first: NDArray[np.int64]  # [N + 1]: robot i has the arcs from first[i] up to first[i + 1], at least one
    miss: float  # most [m] that a given state is off the end of its arc


def arc_between(state: NDArray[np.float64], after: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return (signed length, turn [rad], miss) of the arc from a state towards another.

    The chord of an arc lies at the mean of both headings; the part of the way across it is the miss.
    """
    turn = math.remainder(after[2] - state[2], math.tau)
    mean, dx, dy = state[2] + 0.5 * turn, after[0] - state[0], after[1] - state[1]
    along, across = dx * math.cos(mean) + dy * math.sin(mean), dy * math.cos(mean) - dx * math.sin(mean)
    bow = 0.5 * turn / math.sin(0.5 * turn) if abs(turn) > _STILL else 1.0
    return along * bow, turn, abs(across)


def motions_of(instance: Instance, schedule: dict[str, States], unit: float) -> tuple[Motions, list[Fault]]:
    """Return the arcs, and the faults of each robot: ends, times, jumps, curvature, speed, border."""
    arcs, first, worst = [], [0], 0.0
    faults: list[Fault] = []
    for i, name in enumerate(instance.names):
        states = schedule[name]
        faults += _ends(name, states, instance.starts[i], instance.goals[i], unit)
        for state, after in itertools.pairwise(states):
            length, turn, miss = arc_between(state, after)
            arc = (unit * state[3], unit * after[3], *state[:3], length, turn / length if length else 0.0)
            found = list(_limits(name, arc, turn, miss))
            if not found:
                worst = max(worst, miss)
            faults += found
            off = _beyond(arc, instance, (0.0, 0.0))
            if off > TOLERANCE:
                faults.append(Fault("the axle leaves the floor", name, "", arc[BEGIN], off))
            arcs.append(arc if arc[1] > arc[0] else (arc[0], arc[0], *state[:3], 0.0, 0.0))
        last = states[-1]
        arcs.append((unit * last[3], unit * last[3], *last[:3], 0.0, 0.0))
        first.append(len(arcs))
    return Motions(np.array(arcs, np.float64), np.array(first, np.int64), worst), faults


def _ends(
    name: str, states: States, start: NDArray[np.float64], goal: NDArray[np.float64], unit: float
) -> Iterator[Fault]:
    if states[0, 3] < -1e-9:
        yield Fault("begins before the time 0", name, "", unit * states[0, 3], -unit * states[0, 3])
    for what, state, pose in (("begins off its start", states[0], start), ("ends off its goal", states[-1], goal)):
        off = math.dist(state[:2], pose[:2]) + abs(math.remainder(state[2] - pose[2], math.tau))
        if off > TOLERANCE:
            yield Fault(what, name, "", unit * state[3], off)


def _limits(name: str, arc: tuple[float, ...], turn: float, miss: float) -> Iterator[Fault]:
    """Yield the limits that an arc breaks by more than TOLERANCE."""
    seconds, length = arc[END] - arc[BEGIN], abs(arc[LENGTH])
    if miss > TOLERANCE:
        yield Fault("states that no arc joins", name, "", arc[BEGIN], miss)
    if BODY.radius * abs(turn) - length > TOLERANCE:
        yield Fault("a turn that is too tight", name, "", arc[BEGIN], abs(turn) / max(length, 1e-9) - 1 / BODY.radius)
    if seconds < -1e-9:
        yield Fault("time runs backwards", name, "", arc[BEGIN], -seconds)
    elif length > seconds + TOLERANCE:
        yield Fault("too fast", name, "", arc[BEGIN], length / max(seconds, 1e-9) - 1.0)


def body_beyond(motions: Motions, instance: Instance) -> float:
    """Return how far a corner of a body reaches beyond the floor's border, 0 if none does."""
    return max(0.0, *(_beyond(arc, instance, point) for arc in motions.arcs.tolist() for point in _CORNERS))


def _beyond(arc: tuple[float, ...], instance: Instance, point: tuple[float, float]) -> float:
    """Return how far a point of a body, ahead and left of its axle, reaches beyond the border on an arc."""
    low_x, high_x, low_y, high_y = extent(arc, *point)
    return max(-low_x, high_x - instance.width, -low_y, high_y - instance.height)


def extent(arc: tuple[float, ...] | list[float], ahead: float, left: float) -> tuple[float, float, float, float]:
    """Return the least and greatest x, then y, that a point of a body takes on an arc.

    On a circle they are at the ends or where the point is due east, north, west or south of the centre.
    """
    x, y, heading, length, bend = arc[X:]
    c, s = math.cos(heading), math.sin(heading)
    px, py = x + ahead * c - left * s, y + ahead * s + left * c
    if abs(bend) < _STILL:
        xs, ys = [px, px + length * c], [py, py + length * s]
        return min(xs), max(xs), min(ys), max(ys)
    middle_x, middle_y = x - s / bend, y + c / bend
    radius, angle = math.hypot(px - middle_x, py - middle_y), math.atan2(py - middle_y, px - middle_x)
    low, high = sorted((angle, angle + length * bend))
    quarters = range(math.ceil(low / (0.5 * math.pi)), math.floor(high / (0.5 * math.pi)) + 1)
    angles = [low, high, *(0.5 * math.pi * quarter for quarter in quarters)]
    xs = [middle_x + radius * math.cos(at) for at in angles]
    ys = [middle_y + radius * math.sin(at) for at in angles]
    return min(xs), max(xs), min(ys), max(ys)
