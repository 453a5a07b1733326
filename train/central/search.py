"""A search over pose and time for one robot's route: early, and with few meetings of other robots.

Hybrid-state A* (Dolgov et al. 2010) with time: a node is a pose after a number of equal steps, in each of which a robot
waits or drives straight on or along its tightest arc, forwards or backwards. Every expanded node tries whole
Reeds-Shepp curves to the goal. Motion off the floor or over a disc is excluded; a meeting costs seconds (as in
MAPF-LNS2, Li et al. 2022), so that there is a route even if none is free yet.
"""

from typing import NamedTuple

import numpy as np

from train.central.curves import Best, step_time, try_curves
from train.central.floor import is_free
from train.central.traffic import BEGIN, BEND, END, HEADING, RATE, X, Y, meetings, piece_at
from train.central.tree import MOVES, NONE, RATES, SIDES, TO_GO, is_known, place_of
from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, kernel, part
from warehouse_env.routes.reeds_shepp import SEGMENTS, TURNS, distance, rolled, seen_from, word

_GREED = 1.5  # weight of the way to go: soon found before best
_EPSILON = 1e-6  # [s] that a route must be better by
_STRAIGHT = 1e-9  # segments that are shorter are left out


class Limits(NamedTuple):
    """The limits of a search."""

    most: int  # nodes until a route is found ...
    enough: int  # ... and once there is one
    bound: float  # [s], cost that a route must stay below


@part
def _to_go(x, y, heading, task, floor):
    """Return the time of the shortest curve to the goal on an empty floor [s]."""
    ahead, left, turn = seen_from(x, y, heading, *task.gate)
    return distance(ahead, left, turn, floor.radius) + task.tail_seconds


@part
def _expand(task, node, bound, size, used, traffic, floor, tree):
    """Add what a node leads to at less than `bound` to the queue; return the queue's size and the number of nodes."""
    x, y, heading = tree.nodes[node, 0], tree.nodes[node, 1], tree.nodes[node, 2]
    step, before = tree.steps[node] + 1, tree.met[node]
    seconds, stamp = step_time(task, floor), task.stamp
    begin, after = (step - 1) * seconds, step * seconds
    for move in range(MOVES):
        rate, bend = RATES[move], SIDES[move] / floor.radius
        to_x, to_y, to = rolled(x, y, heading, rate * seconds, bend)
        place, key = place_of(to_x, to_y, to, step, task.fine, floor.radius, stamp, tree)
        if used == tree.parents.size or is_known(place, before, stamp, tree):
            continue
        to_go = tree.nodes[node, TO_GO] if rate == 0.0 else _to_go(to_x, to_y, to, task, floor)
        room = (bound - after - to_go) / task.price - before
        if room <= 0.0 or (rate != 0.0 and not is_free(x, y, heading, rate * seconds, bend, floor)):
            continue
        piece = piece_at(begin, x, y, heading, rate, bend, seconds)
        met = before + meetings(task.robot, piece, int(min(room, 1e6)) + 1, traffic, floor)
        if after + to_go + task.price * met >= bound or is_known(place, met, stamp, tree):
            continue
        tree.stamps[place], tree.cells[place], tree.fewest[place] = stamp, key, met
        tree.nodes[used, 0], tree.nodes[used, 1], tree.nodes[used, 2], tree.nodes[used, TO_GO] = to_x, to_y, to, to_go
        tree.steps[used], tree.met[used], tree.parents[used], tree.moves[used] = step, met, node, move
        size = push(tree.keys, tree.queue, size, after + _GREED * to_go + task.price * met, used)
        used += 1
    return size, used


@inline
def _append(route, count, piece):
    """Add a piece to a route, or lengthen its last one if it continues it; return the number of pieces."""
    if count > 0 and route[count - 1, RATE] == piece.rate and route[count - 1, BEND] == piece.bend:
        route[count - 1, END] = piece.end
        return count
    p = route[count]
    p[BEGIN], p[X], p[Y], p[HEADING], p[RATE], p[BEND], p[END] = piece
    return count + 1


@part
def _write(task, best, route, floor, tree):
    """Write the pieces of the best route; return (how many, the second at which its curve begins)."""
    node, count, step = np.int64(best.node), 0, step_time(task, floor)
    depth = tree.steps[node]
    if depth + SEGMENTS + 2 + task.tail.shape[0] > route.shape[0]:
        return NONE, 0.0
    for k in range(depth, 0, -1):  # the queue is no longer needed, and takes the chain
        tree.queue[k] = node
        node = np.int64(tree.parents[node])
    for k in range(depth):
        a, move = tree.nodes[node], tree.moves[tree.queue[k + 1]]
        bend = SIDES[move] / floor.radius
        count = _append(route, count, piece_at(k * step, a[0], a[1], a[2], RATES[move], bend, step))
        node = np.int64(tree.queue[k + 1])
    x, y, heading, t = tree.nodes[node, 0], tree.nodes[node, 1], tree.nodes[node, 2], depth * step
    if best.wait > 0.0:
        count = _append(route, count, piece_at(t, x, y, heading, 0.0, 0.0, best.wait))
        t += best.wait
    begins = t
    ahead, left, turn = seen_from(x, y, heading, *task.gate)
    parts = word(best.word, ahead, left, turn, floor.radius)[1:]
    for k in range(SEGMENTS):
        if abs(parts[k]) > _STRAIGHT:
            bend, rate, seconds = TURNS[best.word, k] / floor.radius, 1.0 if parts[k] > 0.0 else -1.0, abs(parts[k])
            count = _append(route, count, piece_at(t, x, y, heading, rate, bend, seconds))
            x, y, heading = rolled(x, y, heading, parts[k], bend)
            t += seconds
    for k in range(task.tail.shape[0]):
        p = task.tail[k]
        piece = piece_at(t + p[BEGIN], p[X], p[Y], p[HEADING], p[RATE], p[BEND], p[END] - p[BEGIN])
        count = _append(route, count, piece)
    if count == 0:
        count = _append(route, count, piece_at(0.0, x, y, heading, 0.0, 0.0, 0.0))
    return count, begins


@kernel
def search(task, limits, traffic, floor, tree, route):
    """Write the best route found into route float64[P, PIECE].

    Returns (pieces, NONE if there is no route; cost [s]: the arrival and the meetings' price; the second at which its
    last curve begins; nodes looked at).
    """
    step = step_time(task, floor)
    x, y, heading = task.start
    tree.nodes[0, 0], tree.nodes[0, 1], tree.nodes[0, 2] = x, y, heading
    tree.nodes[0, TO_GO] = _to_go(x, y, heading, task, floor)
    tree.steps[0], tree.met[0], tree.parents[0], tree.moves[0] = 0, 0, NONE, NONE
    size, used, looked = push(tree.keys, tree.queue, 0, 0.0, 0), 1, 0
    best = Best(limits.bound, NONE, NONE, 0.0)
    deepest = int((task.later.size - 3) / step)
    while size > 0 and looked < (limits.most if best.node == NONE else limits.enough):
        _, popped, size = pop(tree.keys, tree.queue, size)
        node = np.int64(popped)
        t, met = tree.steps[node] * step, tree.met[node]
        if t + tree.nodes[node, TO_GO] + task.price * met >= best.cost - _EPSILON:
            continue
        looked += 1
        best = try_curves(task, node, best, traffic, floor, tree)
        if tree.steps[node] < deepest:
            size, used = _expand(task, node, best.cost - _EPSILON, size, used, traffic, floor, tree)
    if best.node == NONE:
        return NONE, best.cost, 0.0, looked
    count, begins = _write(task, best, route, floor, tree)
    return count, best.cost, begins, looked
