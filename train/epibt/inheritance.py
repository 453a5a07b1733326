"""Priority inheritance over sequences of motions (EPIBT, arXiv 2511.09193, after PIBT of Okumura et al. 2022).

Every robot always holds a sequence that ends at rest, and no two held sequences touch. In each decision the robots
choose in turn: first those that retreat, then the others, the oldest task first, where a retreat makes a task new.
Robots that are served or parked stand. A robot takes its cheapest sequence that is clear of all held ones. If its way
along the route is not clear, it also considers arcs. A cheaper sequence may push a few robots that have not chosen yet.
These then choose next, with its priority, and may push others in turn. If one of them finds no sequence, the attempt is
undone. A robot that finds none keeps the sequence that it holds.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.epibt.sequences import (
    AHEAD,
    ARC_SPEED,
    KEPT,
    PLANNED,
    STANDS,
    SWEEP,
    body_with,
    estimate,
    keeps_off_shelves,
    roll_out,
)  # fmt: skip
from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.simulation.physics.geometry import grown, rectangles_touch, squared_distance
from warehouse_env.simulation.physics.sweep import Sweep, touch_between
from warehouse_env.simulation.physics.trigonometry import ZERO

DEPTH = 12  # most robots in a chain of pushes
_PUSHED = 3  # most robots that a sequence may push
_OPTIONS = 12  # most sequences of a robot that push others and are tried
_CHOICES = 200  # most choices of robots because one robot pushes
_GAP = np.float32(0.005)  # [m] around each body
_MOVED = np.float32(0.6)  # [m], more than any points of two bodies move between two poses
_PUSHES = np.float32(0.3)  # [s], price of each push by a robot that is pushed itself
_GETS_ON = np.float32(0.3)  # [s], least saving over braking for which a robot considers no arcs
NONE = -1


class Choosing(NamedTuple):
    """What N robots have chosen so far, and the stack of robots that push each other."""

    held: NDArray[np.int64]  # [N], the sequence that each holds
    locked: NDArray[np.bool_]  # [N], whether it has chosen
    lifted: NDArray[np.bool_]  # [N], whether it is pushed: others need not keep clear of its sequence
    keys: NDArray[np.float32]  # [K], a heap of sequences by cost
    items: NDArray[np.int64]  # [K]
    # of each robot on the stack, [DEPTH + 1, ...]:
    who: NDArray[np.int64]  # the robot,
    best: NDArray[np.int64]  # its best sequence that pushes no robot, or NONE,
    least: NDArray[np.float32]  # what that costs [s],
    options: NDArray[np.int64]  # [..., _OPTIONS + 1, 1 + _PUSHED], sequences and the robots that they push, or NONE,
    prices: NDArray[np.float32]  # [..., _OPTIONS] [s],
    many: NDArray[np.int64]  # how many options there are,
    tried: NDArray[np.int64]  # the option tried, and
    before: NDArray[np.int64]  # [..., 3, N], held, locked and lifted as they were


def make_choosing(robots: int, count: int) -> Choosing:
    """Return room for the choices among `count` sequences of each robot."""
    deep, ints = DEPTH + 1, np.int64
    return Choosing(
        np.zeros(robots, ints), np.zeros(robots, np.bool_), np.zeros(robots, np.bool_),
        np.zeros(count, np.float32), np.zeros(count, ints), np.zeros(deep, ints), np.zeros(deep, ints),
        np.zeros(deep, np.float32), np.zeros((deep, _OPTIONS + 1, 1 + _PUSHED), ints),
        np.zeros((deep, _OPTIONS), np.float32), np.zeros(deep, ints), np.zeros(deep, ints),
        np.zeros((deep, 3, robots), ints),
    )  # fmt: skip


@part
def touch(i, k, j, m, params, sequences):
    """Return whether sequence k of robot i touches sequence m of robot j, exactly on the whole way."""
    one, other, p, q = sequences.boxes[i, k], sequences.boxes[j, m], params[i], params[j]
    circles, two = p["radius"] + q["radius"], np.float32(2.0)
    reach = circles + _MOVED
    if one[0] > other[1] + reach or other[0] > one[1] + reach:
        return False
    if one[2] > other[3] + reach or other[2] > one[3] + reach:
        return False
    poses, counts, last, was_near = sequences.poses, sequences.counts[i, k] - 1, sequences.counts[j, m] - 1, True
    for n in range(max(counts, last) + 1):
        a, b = poses[i, k, min(n, counts)], poses[j, m, min(n, last)]
        own, their = a[SWEEP] if n <= counts else ZERO, b[SWEEP] if n <= last else ZERO
        body, other_body, is_near = body_with(a, own + _GAP, p), body_with(b, their + _GAP, q), False
        reach = circles + two * (own + their + two * _GAP)  # of the bodies with this room, by their circles
        if squared_distance(body, other_body) < reach * reach:
            is_near = rectangles_touch(body, other_body)
        if n > 0 and (is_near or was_near):
            body, other_body = body_with(a, ZERO, p), body_with(b, ZERO, q)
            if rectangles_touch(grown(body, _GAP), grown(other_body, _GAP)):
                return True
            before, other_before = poses[i, k, min(n - 1, counts)], poses[j, m, min(n - 1, last)]
            swept = Sweep(body_with(before, ZERO, p), body, ZERO)
            if touch_between(swept, Sweep(body_with(other_before, ZERO, q), other_body, ZERO), q["offset"], p, q):
                return True
        was_near = is_near
    return False


@part
def _find_pushed(i, k, depth, params, sequences, state):
    """Write the robots that sequence k pushes into the next option; return how many, NONE if it may not push them."""
    option, pushed = state.options[depth, state.many[depth]], 0
    for j in range(state.held.shape[0]):
        if j != i and not state.lifted[j] and touch(i, k, j, state.held[j], params, sequences):
            if state.locked[j] or pushed == _PUSHED:
                return whole(NONE)
            option[1 + pushed] = j
            pushed += 1
    for n in range(pushed, _PUSHED):
        option[1 + n] = NONE
    return whole(pushed)


@inline
def _fill_heap(i, sequences, state):
    """Put the known sequences of robot i on the heap; return its size."""
    size = 0
    for k in range(sequences.known[i]):
        size = push(state.keys, state.items, size, sequences.costs[i, k], k)
    return size


@inline
def _take(i, size, scene, sequences, state):
    """Roll out the cheapest sequence of robot i and take it off the heap; return (cost [s], number, new size)."""
    while True:
        cost, k, size = pop(state.keys, state.items, size)
        if sequences.counts[i, k] > 0:
            return cost, k, size
        roll_out(i, k, scene, sequences)
        size = push(state.keys, state.items, size, sequences.costs[i, k], k)


@inline
def _consider(i, k, depth, scene, sequences, state):
    """Make sequence k of robot i the best one or an option, if it is allowed and cheaper than the best one."""
    pushed = _find_pushed(i, k, depth, scene.params, sequences, state)
    if pushed == NONE or (pushed > 0 and (depth == DEPTH or state.many[depth] == _OPTIONS)):
        return
    cost = sequences.costs[i, k]
    if pushed == 0 and cost < state.least[depth]:
        state.best[depth], state.least[depth] = k, cost
    elif pushed > 0:
        option = state.many[depth]
        state.options[depth, option, 0] = k
        state.prices[depth, option] = cost + (_PUSHES * np.float32(pushed) if depth > 0 else ZERO)
        state.many[depth] = option + 1


@part
def _choose(i, depth, scene, sequences, state):
    """Put robot i on the stack: find its best sequence that pushes no robot, and better ones that do."""
    state.locked[i], state.who[depth], state.tried[depth] = True, i, NONE
    state.best[depth], state.least[depth], state.many[depth] = NONE, np.float32(np.inf), 0
    estimate(i, AHEAD + 1, scene, sequences)
    first = whole(PLANNED) if sequences.arc[i, ARC_SPEED] < ZERO else whole(AHEAD)
    roll_out(i, first, scene, sequences)
    cost = sequences.costs[i, first]
    if cost < sequences.costs[i, STANDS] - _GETS_ON and keeps_off_shelves(i, first, scene, sequences):
        _consider(i, first, depth, scene, sequences, state)
        if state.least[depth] == cost:
            return
    estimate(i, scene.table.shape[0], scene, sequences)
    state.best[depth], state.least[depth], state.many[depth] = NONE, np.float32(np.inf), 0
    size = _fill_heap(i, sequences, state)
    while size > 0:
        cost, item, size = _take(i, size, scene, sequences, state)
        if cost >= state.least[depth]:
            break
        if keeps_off_shelves(i, item, scene, sequences):
            _consider(i, item, depth, scene, sequences, state)


@inline
def _undo(depth, state):
    """Undo all choices made since a robot on the stack tried its option."""
    for j in range(state.held.shape[0]):
        state.held[j] = state.before[depth, 0, j]
        state.locked[j], state.lifted[j] = state.before[depth, 1, j] != 0, state.before[depth, 2, j] != 0


@inline
def _try_next(depth, may_push, state):
    """Try the next option of a robot on the stack that is better than its best; return whether there is one."""
    i = state.who[depth]
    for option in range(state.tried[depth] + 1, state.many[depth]):
        if state.prices[depth, option] >= state.least[depth] or not may_push:
            continue
        state.tried[depth] = option
        for j in range(state.held.shape[0]):
            state.before[depth, 0, j] = state.held[j]
            state.before[depth, 1, j], state.before[depth, 2, j] = state.locked[j], state.lifted[j]
        state.held[i], state.lifted[i] = state.options[depth, option, 0], False
        for n in range(1, 1 + _PUSHED):
            if state.options[depth, option, n] != NONE:
                state.lifted[state.options[depth, option, n]] = True
        return True
    return False


@inline
def _next_pushed(depth, state):
    """Return the next robot that must choose because of the option tried, or NONE."""
    for n in range(1, 1 + _PUSHED):
        j = state.options[depth, state.tried[depth], n]
        if j != NONE and state.lifted[j]:
            return j
    return whole(NONE)


@part
def _choose_for(first, scene, sequences, state):
    """Let robot `first` and the robots that it pushes choose; return whether it found a sequence."""
    depth, choices, found = 0, 1, False
    _choose(first, depth, scene, sequences, state)
    going = _try_next(depth, True, state)  # whether an option is being tried
    while True:
        if going:
            j = _next_pushed(depth, state)
            if j != NONE:
                depth, choices = depth + 1, choices + 1
                _choose(j, depth, scene, sequences, state)
                going = _try_next(depth, choices < _CHOICES, state)
                continue
            found = True
        else:  # no option is left
            i, found = state.who[depth], state.best[depth] != NONE
            if found:
                state.held[i], state.lifted[i] = state.best[depth], False
            else:
                state.locked[i] = False
        if depth == 0:
            return found
        depth -= 1
        if found:
            going = True
        else:
            _undo(depth, state)
            going = _try_next(depth, choices < _CHOICES, state)


@kernel
def choose_all(scene, sequences, state):
    """Let all robots choose a sequence each: `state.held`."""
    turn = np.argsort(-sequences.ranks, kind="mergesort")  # of equals the lower first
    sequences.known[:] = 0
    for i in range(turn.size):
        estimate(i, KEPT + 1, scene, sequences)
        roll_out(i, KEPT, scene, sequences)
        state.held[i], state.locked[i], state.lifted[i] = KEPT, scene.robots[i]["task"]["alive"] == 0, False
    for i in turn:
        if not state.locked[i] and not _choose_for(i, scene, sequences, state):
            state.held[i], state.locked[i] = KEPT, True
