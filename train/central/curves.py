"""Whole Reeds-Shepp curves from a node of a search to the goal, compared with the best route so far."""

from typing import Any, NamedTuple

import numpy as np

from train.central.floor import is_free
from train.central.traffic import BEGIN, BEND, END, HEADING, RATE, X, Y, meetings, piece_at
from train.central.tree import TURN
from warehouse_env.kernel import inline, part
from warehouse_env.routes.reeds_shepp import SEGMENTS, TURNS, WORDS, rolled, seen_from, word

_TRIES, _FIRST_TRIES, _FIRST_WAITS = 2, 8, 6  # curves from a node and from the start, there after up to so many waits
_MANY = 1e6  # meetings, as good as no limit


class RouteTask(NamedTuple):
    """The task of one robot: a route to a gate, from which the tail leads to the goal."""

    robot: int
    start: tuple[float, float, float]
    gate: tuple[float, float, float]  # the goal itself, unless a search cannot end in so tight a place
    tail: Any  # float64[K, PIECE], times from the gate on; K 0: the gate is the goal
    tail_seconds: float
    later: Any  # int32[S + 1], see traffic.passers
    price: float  # [s] of a meeting
    fine: int  # 1, 2, 4 or 8: steps to one of tree.TURN
    stamp: int  # unique number of the search in its tree


class WordCurve(NamedTuple):
    """A Reeds-Shepp curve from a pose to the gate."""

    x: float
    y: float
    heading: float
    word: int
    length: float
    parts: tuple[float, ...]  # signed lengths of its segments


class Best(NamedTuple):
    """The best route so far: to a node, a wait there, and a word from there to the gate."""

    cost: float  # [s], meetings included
    node: int
    word: int
    wait: float


@inline
def step_time(task, floor):
    """Return the seconds of a step of a search."""
    return TURN * floor.radius / task.fine


@part
def _is_free_curve(curve, floor):
    """Return whether the segments of a curve stay on the floor and off the discs."""
    x, y, heading, n, _, parts = curve
    for k in range(SEGMENTS):
        if parts[k] != 0.0:
            bend = TURNS[n, k] / floor.radius
            if not is_free(x, y, heading, parts[k], bend, floor):
                return False
            x, y, heading = rolled(x, y, heading, parts[k], bend)
    return True


@part
def _curve_meetings(task, curve, t, most, traffic, floor):
    """Return the meetings of a robot on a curve from t [s] on and on the tail, counted up to `most`."""
    x, y, heading, n, _, parts = curve
    count = 0
    for k in range(SEGMENTS):
        if parts[k] != 0.0 and count < most:
            bend, rate, seconds = TURNS[n, k] / floor.radius, 1.0 if parts[k] > 0.0 else -1.0, abs(parts[k])
            piece = piece_at(t, x, y, heading, rate, bend, seconds)
            count += meetings(task.robot, piece, most - count, traffic, floor)
            x, y, heading = rolled(x, y, heading, parts[k], bend)
            t += seconds
    for k in range(task.tail.shape[0]):
        p = task.tail[k]
        if count < most:
            piece = piece_at(t + p[BEGIN], p[X], p[Y], p[HEADING], p[RATE], p[BEND], p[END] - p[BEGIN])
            count += meetings(task.robot, piece, most - count, traffic, floor)
    return count


@part
def _hold(task, reached, curve, wait, best, traffic, floor):
    """Compare a wait and a free curve with the best route so far; return the better.

    reached: the node, the time [s] and the meetings so far. If others still pass over the goal at the arrival, the wait
    grows until they are gone.
    """
    node, t, met = reached
    for _ in range(2):
        arrival = t + wait + curve.length + task.tail_seconds
        if arrival >= task.later.size - 2:
            break
        passing = task.later[int(arrival)]
        total = arrival + task.price * (met + passing)
        if total < best.cost:
            most, count = int(min((best.cost - total) / task.price, _MANY)) + 1, 0
            if wait > 0.0:
                waiting = piece_at(t, curve.x, curve.y, curve.heading, 0.0, 0.0, wait)
                count = meetings(task.robot, waiting, most, traffic, floor)
            count += _curve_meetings(task, curve, t + wait, most - count, traffic, floor)
            total += task.price * count
            if total < best.cost:
                best = Best(total, node, curve.word, wait)
        if passing == 0:
            break
        clear = int(arrival) + 1
        while task.later[clear] > 0:
            clear += 1
        wait += clear - arrival
    return best


@part
def try_curves(task, node, best, traffic, floor, tree):
    """Try the shortest curves from a node, at the start also after waits; return the best route."""
    tries, waits = (_FIRST_TRIES, _FIRST_WAITS) if node == 0 else (_TRIES, 0)
    step = step_time(task, floor)
    t = tree.steps[node] * step
    x, y, heading, met = tree.nodes[node, 0], tree.nodes[node, 1], tree.nodes[node, 2], tree.met[node]
    so_far = t + task.price * met + task.tail_seconds
    ahead, left, turn = seen_from(x, y, heading, *task.gate)
    for n in range(WORDS):
        tree.lengths[n] = word(n, ahead, left, turn, floor.radius)[0]
    for _ in range(tries):
        n = int(np.argmin(tree.lengths))
        length = tree.lengths[n]
        if so_far + length >= best.cost:
            break
        tree.lengths[n] = np.inf
        parts = word(n, ahead, left, turn, floor.radius)[1:]
        curve = WordCurve(x, y, heading, n, length, parts)
        if not _is_free_curve(curve, floor):
            continue
        for k in range(waits + 1):
            if so_far + length + k * step >= best.cost:
                break
            best = _hold(task, (node, t, met), curve, k * step, best, traffic, floor)
    return best
