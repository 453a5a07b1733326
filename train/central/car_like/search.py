"""One robot's route among the others': a search over pose and time for an early one with few meetings.

Hybrid-state A* (Dolgov et al. 2010) with time: a node is a pose after a number of equal steps, in each of which a robot
waits, or drives straight on or along its tightest arc, forwards or backwards. From every node that is looked at, whole
Reeds-Shepp curves to the goal are tried. What is off the floor or on a disc is left out; a meeting with others costs
seconds (as in MAPF-LNS2, Li et al. 2022), so that there is a route even where none is free yet.
"""

from __future__ import annotations

import numpy as np

from train.central.car_like.curves import Best, try_curves
from train.central.car_like.floor import is_free
from train.central.car_like.traffic import BEGIN, BEND, END, HEADING, RATE, X, Y, meetings
from train.central.car_like.tree import MOVES, NONE, RATES, SIDES, TO_GO, TURN, is_known, place_of
from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, kernel, part
from warehouse_env.routes.reeds_shepp import SEGMENTS, TURNS, distance, rolled, seen_from, word

_GREED = 1.5  # weight of the way to go: soon found before best
_TRIES, _FIRST_TRIES, _FIRST_WAITS = 2, 8, 6  # curves from a node and from the start, there after up to so many waits
_EPSILON = 1e-6  # [s] that a route must be better by
_STRAIGHT = 1e-9  # segments that are shorter are left out


@part
def _to_go(x, y, heading, task, floor):
    """Return the seconds of the shortest way to the goal on open floor."""
    gate = task.gate
    ahead, left, turn = seen_from(x, y, heading, gate[0], gate[1], gate[2])
    return distance(ahead, left, turn, floor.radius) + task.tail_seconds


@part
def _expand(task, node, step_time, bound, size, used, stamp, traffic, floor, tree):
    """Add what a node leads to at less than `bound` to the queue; return the queue's size and the number of nodes."""
    x, y, heading = tree.nodes[node, 0], tree.nodes[node, 1], tree.nodes[node, 2]
    step, before = tree.steps[node] + 1, tree.met[node]
    begin, after = (step - 1) * step_time, step * step_time
    for move in range(MOVES):
        rate, bend = RATES[move], SIDES[move] / floor.radius
        to_x, to_y, to = rolled(x, y, heading, rate * step_time, bend)
        place, key = place_of(to_x, to_y, to, step, task.fine, floor.radius, stamp, tree)
        if used == tree.parents.size or is_known(place, before, stamp, tree):
            continue
        to_go = tree.nodes[node, TO_GO] if rate == 0.0 else _to_go(to_x, to_y, to, task, floor)
        room = (bound - after - to_go) / task.price - before
        if room <= 0.0 or (rate != 0.0 and not is_free(x, y, heading, rate * step_time, bend, floor)):
            continue
        most = int(min(room, 1e6)) + 1
        met = before + meetings(task.robot, x, y, heading, rate, bend, begin, step_time, most, traffic, floor)
        if after + to_go + task.price * met >= bound or is_known(place, met, stamp, tree):
            continue
        tree.stamps[place], tree.cells[place], tree.fewest[place] = stamp, key, met
        tree.nodes[used, 0], tree.nodes[used, 1], tree.nodes[used, 2], tree.nodes[used, TO_GO] = to_x, to_y, to, to_go
        tree.steps[used], tree.met[used], tree.parents[used], tree.moves[used] = step, met, node, move
        size = push(tree.keys, tree.queue, size, after + _GREED * to_go + task.price * met, used)
        used += 1
    return size, used


@inline
def _append(route, count, t, x, y, heading, rate, bend, seconds):
    """Add a piece to a route, or lengthen its last one where that goes on so; return the number of pieces."""
    if count > 0 and route[count - 1, RATE] == rate and route[count - 1, BEND] == bend:
        route[count - 1, END] = t + seconds
        return count
    p = route[count]
    p[BEGIN], p[X], p[Y], p[HEADING], p[RATE], p[BEND], p[END] = t, x, y, heading, rate, bend, t + seconds
    return count + 1


@part
def _write(task, best, step_time, route, floor, tree):
    """Write the pieces of the best route; return (how many, the second at which its curve begins)."""
    node, count = np.int64(best.node), 0
    depth = tree.steps[node]
    if depth + SEGMENTS + 2 + task.tail.shape[0] > route.shape[0]:
        return NONE, 0.0
    for k in range(depth, 0, -1):  # the queue is no longer needed, and takes the chain
        tree.queue[k] = node
        node = np.int64(tree.parents[node])
    for k in range(depth):
        a, move = tree.nodes[node], tree.moves[tree.queue[k + 1]]
        bend = SIDES[move] / floor.radius
        count = _append(route, count, k * step_time, a[0], a[1], a[2], RATES[move], bend, step_time)
        node = np.int64(tree.queue[k + 1])
    x, y, heading, t = tree.nodes[node, 0], tree.nodes[node, 1], tree.nodes[node, 2], depth * step_time
    if best.wait > 0.0:
        count = _append(route, count, t, x, y, heading, 0.0, 0.0, best.wait)
        t += best.wait
    begins = t
    ahead, left, turn = seen_from(x, y, heading, task.gate[0], task.gate[1], task.gate[2])
    parts = word(best.word, ahead, left, turn, floor.radius)[1:]
    for k in range(SEGMENTS):
        if abs(parts[k]) > _STRAIGHT:
            bend, rate, seconds = TURNS[best.word, k] / floor.radius, 1.0 if parts[k] > 0.0 else -1.0, abs(parts[k])
            count = _append(route, count, t, x, y, heading, rate, bend, seconds)
            x, y, heading = rolled(x, y, heading, parts[k], bend)
            t += seconds
    for k in range(task.tail.shape[0]):
        p = task.tail[k]
        count = _append(route, count, t + p[BEGIN], p[X], p[Y], p[HEADING], p[RATE], p[BEND], p[END] - p[BEGIN])
    if count == 0:
        count = _append(route, count, 0.0, x, y, heading, 0.0, 0.0, 0.0)
    return count, begins


@kernel
def search(task, most, enough, bound, stamp, traffic, floor, tree, route):
    """Write the best route found into route float64[P, PIECE].

    most: nodes that are looked at, `enough` where a route has been found; bound: [s] it must cost less than; stamp:
    another whole number for each search in the same tree. Returns (pieces, NONE if there is no route; cost [s]: the
    arrival and the meetings' price; the second at which its last curve begins; nodes looked at).
    """
    step_time = TURN * floor.radius / task.fine
    x, y, heading = task.start
    tree.nodes[0, 0], tree.nodes[0, 1], tree.nodes[0, 2] = x, y, heading
    tree.nodes[0, TO_GO] = _to_go(x, y, heading, task, floor)
    tree.steps[0], tree.met[0], tree.parents[0], tree.moves[0] = 0, 0, NONE, NONE
    size, used, looked = push(tree.keys, tree.queue, 0, 0.0, 0), 1, 0
    best = Best(bound, NONE, NONE, 0.0)
    deepest = int((task.later.size - 3) / step_time)
    while size > 0 and looked < (most if best.node == NONE else enough):
        _, popped, size = pop(tree.keys, tree.queue, size)
        node = np.int64(popped)
        t, met = tree.steps[node] * step_time, tree.met[node]
        if t + tree.nodes[node, TO_GO] + task.price * met >= best.cost - _EPSILON:
            continue
        looked += 1
        tries, waits = (_FIRST_TRIES, _FIRST_WAITS) if looked == 1 else (_TRIES, 0)
        best = try_curves(task, node, t, best, tries, waits, step_time, traffic, floor, tree)
        if tree.steps[node] < deepest:
            below = best.cost - _EPSILON
            size, used = _expand(task, node, step_time, below, size, used, stamp, traffic, floor, tree)
    if best.node == NONE:
        return NONE, best.cost, 0.0, looked
    count, begins = _write(task, best, step_time, route, floor, tree)
    return count, best.cost, begins, looked
