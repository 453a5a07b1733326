"""Priority inheritance over sequences of motions (EPIBT, arXiv 2511.09193, after PIBT of Okumura et al. 2022).

Every robot always holds a sequence that ends at rest, and no two of these ever touch. Robots choose anew in turn, the
one longest on its way first. It takes its best sequence that is clear of those held; only if its way along the route is
not clear, arcs are rolled out as well. A better one may be in the way of a few robots that have not chosen yet: these
choose first, with its priority, and may push others in turn. If one of them finds nothing, all this is undone. A robot
that finds nothing keeps what it holds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.epibt.sequences import ALONG, STANDS, SWEEP, X, Y, body_with, keeps_off_shelves, roll_out
from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.simulation.physics.geometry import grown, rectangles_touch, squared_distance
from warehouse_env.simulation.physics.sweep import Sweep, touch_between
from warehouse_env.simulation.physics.trigonometry import ZERO

DEPTH = 12  # robots in a row that push each other
_PUSHED = 3  # robots that a sequence may push
_OPTIONS = 12  # sequences that push others, of a robot
_CHOICES = 200  # of robots, for the sake of one
_GAP = np.float32(0.005)  # [m] around each body
_PUSHES = np.float32(0.3)  # [s], price of pushing a robot, for one that is pushed itself
_GETS_ON = np.float32(0.3)  # [s] less than braking, from which a way along the route is good enough
_IN_THE_WAY = np.float32(1.0)  # [s], price of stopping where a robot that goes first wants to drive,
_COUNTED = 2  # such robots at most
_BESIDE = np.float32(0.05)  # [m] around the bodies on their way
NONE = -1


class Choosing(NamedTuple):
    """What N robots have chosen so far, and the stack of those who choose for the sake of one."""

    held: NDArray[np.int64]  # [N], the sequence that each holds
    locked: NDArray[np.bool_]  # [N], whether it has chosen
    lifted: NDArray[np.bool_]  # [N], whether it is pushed, so that nobody need keep clear of what it holds
    keys: NDArray[np.float32]  # [K], a heap of sequences by cost
    items: NDArray[np.int64]  # [K]
    wishes: NDArray[np.int64]  # [N], the best along the route that keeps off shelves
    easy: NDArray[np.bool_]  # [N], whether that is the best of all along the route
    ranks: NDArray[np.int64]  # [N], 0: first
    # of each robot on the stack, [DEPTH + 1, ...]:
    who: NDArray[np.int64]  # the robot,
    best: NDArray[np.int64]  # its best sequence that pushes nobody, or NONE,
    least: NDArray[np.float32]  # what that costs [s],
    options: NDArray[np.int64]  # [..., _OPTIONS + 1, 1 + _PUSHED], sequences and whom they push, or NONE,
    prices: NDArray[np.float32]  # [..., _OPTIONS] [s],
    many: NDArray[np.int64]  # how many options there are,
    tried: NDArray[np.int64]  # the option tried, and
    before: NDArray[np.int64]  # [..., 3, N], held, locked and lifted as they were


def make_choosing(robots: int, count: int) -> Choosing:
    """Return room for the choices among `count` sequences of each robot."""
    deep, ints = DEPTH + 1, np.int64
    return Choosing(
        np.zeros(robots, ints), np.zeros(robots, np.bool_), np.zeros(robots, np.bool_),
        np.zeros(count, np.float32), np.zeros(count, ints), np.zeros(robots, ints), np.zeros(robots, np.bool_),
        np.zeros(robots, ints), np.zeros(deep, ints), np.zeros(deep, ints),
        np.zeros(deep, np.float32), np.zeros((deep, _OPTIONS + 1, 1 + _PUSHED), ints),
        np.zeros((deep, _OPTIONS), np.float32), np.zeros(deep, ints), np.zeros(deep, ints),
        np.zeros((deep, 3, robots), ints),
    )  # fmt: skip


@part
def touch(i, k, j, m, p, sequences):
    """Return whether sequence k of robot i touches sequence m of robot j, exactly on the whole way."""
    one, other = sequences.boxes[i, k], sequences.boxes[j, m]
    reach = np.float32(2.0) * p["radius"] + np.float32(0.2)
    if one[0] > other[1] + reach or other[0] > one[1] + reach:
        return False
    if one[2] > other[3] + reach or other[2] > one[3] + reach:
        return False
    poses, counts, last, was_near = sequences.poses, sequences.counts[i, k] - 1, sequences.counts[j, m] - 1, True
    for n in range(max(counts, last) + 1):
        a, b = poses[i, k, min(n, counts)], poses[j, m, min(n, last)]
        own, their = a[SWEEP] if n <= counts else ZERO, b[SWEEP] if n <= last else ZERO
        body, other_body, is_near = body_with(a, own + _GAP, p), body_with(b, their + _GAP, p), False
        if squared_distance(body, other_body) < reach * reach:
            is_near = rectangles_touch(body, other_body)
        if n > 0 and (is_near or was_near):
            body, other_body = body_with(a, ZERO, p), body_with(b, ZERO, p)
            if rectangles_touch(grown(body, _GAP), grown(other_body, _GAP)):
                return True
            before, other_before = poses[i, k, min(n - 1, counts)], poses[j, m, min(n - 1, last)]
            swept = Sweep(body_with(before, ZERO, p), body, ZERO)
            if touch_between(swept, Sweep(body_with(other_before, ZERO, p), other_body, ZERO), p["offset"], p, p):
                return True
        was_near = is_near
    return False


@part
def _in_the_way(i, k, p, sequences, now):
    """Return how many robots that go first want to drive where sequence k of robot i ends, _COUNTED at most."""
    end, count, reach = sequences.poses[i, k, sequences.counts[i, k] - 1], 0, np.float32(2.0) * p["radius"]
    stands = body_with(end, ZERO, p)
    for j in range(now.held.shape[0]):
        m = now.wishes[j]
        if now.ranks[j] >= now.ranks[i] or count == _COUNTED:
            continue
        box = sequences.boxes[j, m]
        if not (box[0] - reach < end[X] < box[1] + reach and box[2] - reach < end[Y] < box[3] + reach):
            continue
        for n in range(0, sequences.counts[j, m], 3):
            body = body_with(sequences.poses[j, m, n], _BESIDE, p)
            if squared_distance(body, stands) < reach * reach and rectangles_touch(body, stands):
                count += 1
                break
    return count


@part
def _whom_it_pushes(i, k, depth, p, sequences, now):
    """Write into the next option whom sequence k pushes; return how many, NONE if it is in the way of too many."""
    option, pushed = now.options[depth, now.many[depth]], 0
    for j in range(now.held.shape[0]):
        if j != i and not now.lifted[j] and touch(i, k, j, now.held[j], p, sequences):
            if now.locked[j] or pushed == _PUSHED:
                return whole(NONE)
            option[1 + pushed] = j
            pushed += 1
    for n in range(pushed, _PUSHED):
        option[1 + n] = NONE
    return whole(pushed)


@inline
def _heap_of(i, sequences, now):
    """Put the known sequences of robot i on the heap; return its size."""
    size = 0
    for k in range(sequences.known[i]):
        size = push(now.keys, now.items, size, sequences.costs[i, k], k)
    return size


@inline
def _consider(i, k, depth, scene, sequences, now):
    """Make sequence k of robot i the best or an option, if it may be driven and is better than the best."""
    pushed = _whom_it_pushes(i, k, depth, scene.p, sequences, now)
    if pushed == NONE or (pushed > 0 and (depth == DEPTH or now.many[depth] == _OPTIONS)):
        return
    price = sequences.costs[i, k] + _IN_THE_WAY * np.float32(_in_the_way(i, k, scene.p, sequences, now))
    if pushed == 0 and price < now.least[depth]:
        now.best[depth], now.least[depth] = k, price
    elif pushed > 0:
        option = now.many[depth]
        now.options[depth, option, 0] = k
        now.prices[depth, option] = price + (_PUSHES * np.float32(pushed) if depth > 0 else ZERO)
        now.many[depth] = option + 1


@part
def _choose(i, depth, scene, sequences, now):
    """Put robot i on the stack: find its best sequence that pushes nobody, and better ones that do."""
    now.locked[i], now.who[depth], now.tried[depth] = True, i, NONE
    now.best[depth], now.least[depth], now.many[depth] = NONE, np.float32(np.inf), 0
    k, costs = now.wishes[i], sequences.costs[i]
    if k > STANDS and now.easy[i] and costs[k] < costs[STANDS] - _GETS_ON:
        _consider(i, k, depth, scene, sequences, now)
        if now.least[depth] == costs[k]:
            return
    roll_out(i, scene.table.shape[0], scene, sequences)
    now.best[depth], now.least[depth], now.many[depth] = NONE, np.float32(np.inf), 0
    size = _heap_of(i, sequences, now)
    while size > 0:
        cost, item, size = pop(now.keys, now.items, size)
        if cost >= now.least[depth]:
            break
        if keeps_off_shelves(i, item, scene, sequences):
            _consider(i, item, depth, scene, sequences, now)


@inline
def _undo(depth, now):
    """Take back what has been chosen since the option of a robot on the stack was tried."""
    for j in range(now.held.shape[0]):
        now.held[j] = now.before[depth, 0, j]
        now.locked[j], now.lifted[j] = now.before[depth, 1, j] != 0, now.before[depth, 2, j] != 0


@inline
def _try_next(depth, may_push, now):
    """Try the next option of a robot on the stack that is better than its best; return whether there is one."""
    i = now.who[depth]
    for option in range(now.tried[depth] + 1, now.many[depth]):
        if now.prices[depth, option] >= now.least[depth] or not may_push:
            continue
        now.tried[depth] = option
        for j in range(now.held.shape[0]):
            now.before[depth, 0, j] = now.held[j]
            now.before[depth, 1, j], now.before[depth, 2, j] = now.locked[j], now.lifted[j]
        now.held[i], now.lifted[i] = now.options[depth, option, 0], False
        for n in range(1, 1 + _PUSHED):
            if now.options[depth, option, n] != NONE:
                now.lifted[now.options[depth, option, n]] = True
        return True
    return False


@inline
def _next_pushed(depth, now):
    """Return the next robot that must choose because of the option tried, or NONE."""
    for n in range(1, 1 + _PUSHED):
        j = now.options[depth, now.tried[depth], n]
        if j != NONE and now.lifted[j]:
            return j
    return whole(NONE)


@part
def _choose_for(first, scene, sequences, now):
    """Let robot `first` choose, and those that it pushes; return whether it found anything."""
    depth, choices, found = 0, 1, False
    _choose(first, depth, scene, sequences, now)
    going = _try_next(depth, True, now)  # an option is tried: those that it pushes choose
    while True:
        if going:
            j = _next_pushed(depth, now)
            if j != NONE:
                depth, choices = depth + 1, choices + 1
                _choose(j, depth, scene, sequences, now)
                going = _try_next(depth, choices < _CHOICES, now)
                continue
            found = True
        else:  # no option is left
            i, found = now.who[depth], now.best[depth] != NONE
            if found:
                now.held[i], now.lifted[i] = now.best[depth], False
            else:
                now.locked[i] = False
        if depth == 0:
            return found
        depth -= 1
        if found:
            going = True
        else:
            _undo(depth, now)
            going = _try_next(depth, choices < _CHOICES, now)


@kernel
def choose_all(scene, sequences, now):
    """Let all robots choose a sequence each: `now.held`."""
    turn = np.argsort(-scene.robots["task"]["age"], kind="mergesort")  # of equals the lower first
    for n in range(turn.size):
        i = turn[n]
        now.ranks[i], sequences.known[i] = n, 0
        roll_out(i, ALONG, scene, sequences)
        now.held[i], now.locked[i], now.lifted[i], now.wishes[i] = 0, False, False, 0
        size, now.easy[i] = _heap_of(i, sequences, now), True
        while size > 0:
            _, k, size = pop(now.keys, now.items, size)
            if keeps_off_shelves(i, k, scene, sequences):
                now.wishes[i] = k
                break
            now.easy[i] = False
    for i in turn:
        if not now.locked[i] and not _choose_for(i, scene, sequences, now):
            now.held[i], now.locked[i] = 0, True
