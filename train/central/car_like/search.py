"""One robot's route among the others': a search over pose and time for the soonest with the fewest meetings.

Hybrid-state A* (Dolgov et al. 2010) with time (a node is a pose after a number of equal steps): in each step a robot
waits, or drives straight on or along its tightest arc, forwards or backwards. From every node that is looked at, whole
Reeds-Shepp curves to the goal are tried. What is off the floor or on a disc is left out; a meeting with others costs
`price` seconds (soft constraints, as in MAPF-LNS2, Li et al. 2022), so that there is a route even if none is free yet.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from train.central.car_like.floor import is_free
from train.central.car_like.traffic import BEGIN, BEND, END, HEADING, PIECE, RATE, X, Y, meetings
from warehouse_env.kernel import inline, kernel, part
from warehouse_env.routes.reeds_shepp import SEGMENTS, TURNS, WORDS, distance, rolled, seen_from, word
from warehouse_env.simulation.driver.heap import pop, push

MOVES = 7
_RATES = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 0.0])
_BENDS = np.array([0.0, 1.0, -1.0, 0.0, 1.0, -1.0, 0.0])
_HEADINGS = 24
_TURN = np.pi / 6.0  # of a step on the tightest arc
_TRIES, _ROOT_TRIES, _ROOT_WAITS = 2, 8, 6
_GREED = 1.5  # weight of the way to go
_CELL = 0.8
_SLOTS = 1 << 18
_NONE = -1


class Work(NamedTuple):
    """What searches write into, made once."""

    nodes: Any  # float64[M, 4]: x, y, heading, way to go
    steps: Any  # int32[M]
    costs: Any  # int32[M], meetings so far
    parents: Any  # int32[M]
    moves: Any  # int8[M]
    keys: Any  # float64[M], of the queue
    queue: Any  # int32[M]
    taken: Any  # int64[_SLOTS]
    stamps: Any  # int32[_SLOTS], of the search that wrote it
    best: Any  # int32[_SLOTS], fewest meetings
    later: Any  # int32[S + 1], see traffic.passers
    words: Any  # float64[WORDS]
    curve: Any  # float64[SEGMENTS + 1, 2]: the best curve's segments


def make_work(nodes: int, slots: int) -> Work:
    """Return arrays for searches of up to this many nodes."""
    return Work(
        np.empty((nodes, 4)), np.empty(nodes, np.int32), np.empty(nodes, np.int32), np.empty(nodes, np.int32),
        np.empty(nodes, np.int8), np.empty(nodes), np.empty(nodes, np.int32), np.empty(_SLOTS, np.int64),
        np.zeros(_SLOTS, np.int32), np.empty(_SLOTS, np.int32), np.zeros(slots + 1, np.int32), np.empty(WORDS),
        np.empty((SEGMENTS, 2)),
    )  # fmt: skip


@part
def _slot_of(x, y, heading, step, fine, stamp, work):
    """Return the place of a pose's cell at a step in the table, free or its own; and its key."""
    column, row = int(np.floor(x / _CELL * fine)), int(np.floor(y / _CELL * fine))
    facing = int(np.floor(heading / (2.0 * np.pi) * (fine * _HEADINGS) + 0.5)) % (fine * _HEADINGS)
    key = ((np.int64(step) * 4096 + column) * 4096 + row) * 1024 + facing
    slot = (((key * np.int64(0x9E3779B97F4A7C1)) >> 20) ^ key) & (_SLOTS - 1)
    while work.stamps[slot] == stamp and work.taken[slot] != key:
        slot = (slot + 1) & (_SLOTS - 1)
    return slot, key


@part
def _curve_meets(i, x, y, heading, t, n, parts, most, traffic, floor):
    """Return how often robot i meets others on a curve begun at t [s], up to `most`; -1 where it is not free."""
    at_x, at_y, at = x, y, heading
    for k in range(SEGMENTS):
        if parts[k] != 0.0:
            bend = TURNS[n, k] / floor.radius
            if not is_free(at_x, at_y, at, parts[k], bend, floor):
                return _NONE
            at_x, at_y, at = rolled(at_x, at_y, at, parts[k], bend)
    count = 0
    for k in range(SEGMENTS):
        if parts[k] != 0.0 and count < most:
            bend, rate, seconds = TURNS[n, k] / floor.radius, 1.0 if parts[k] > 0.0 else -1.0, abs(parts[k])
            count += meetings(i, x, y, heading, rate, bend, t, seconds, most - count, traffic, floor)
            x, y, heading = rolled(x, y, heading, parts[k], bend)
            t += seconds
    return count


@part
def _try_curve(i, node, n, length, parts, wait, best, price, step_time, traffic, floor, work):
    """Hold a wait at a node and a curve from there against the best so far; return (the better, whether it is free).

    Where others still pass over the goal when it arrives, it waits for as much longer.
    """
    cost = best[0]
    x, y, heading = work.nodes[node, 0], work.nodes[node, 1], work.nodes[node, 2]
    t, met = work.steps[node] * step_time, work.costs[node]
    horizon = traffic.first.shape[0]
    arrival = t + wait + length
    for _ in range(2):
        if arrival >= horizon - 1:
            break
        passing = work.later[int(arrival)]
        total = arrival + price * (met + passing)
        if total < cost:
            most, count = int(min((cost - total) / price, 1e6)) + 1, 0
            if wait > 0.0:
                count = meetings(i, x, y, heading, 0.0, 0.0, t, wait, most, traffic, floor)
            driven = _curve_meets(i, x, y, heading, t + wait, n, parts, most - count, traffic, floor)
            if driven == _NONE:
                return best, False
            total += price * (count + driven)
            if total < cost:
                cost = total
                best = (cost, node, n, wait)
        if passing == 0:
            break
        clear = int(arrival) + 1
        while work.later[clear] > 0:
            clear += 1
        wait += clear - arrival
        arrival = t + wait + length
    return best, True


@part
def _try_curves(i, node, goal, best, tries, waits, price, step_time, traffic, floor, work):
    """Try the shortest curves from a node to the goal, after up to `waits` steps of waiting; return the best so far.

    best: (cost, node, word, seconds waited before it).
    """
    x, y, heading = work.nodes[node, 0], work.nodes[node, 1], work.nodes[node, 2]
    so_far = work.steps[node] * step_time + price * work.costs[node]
    ahead, left, turn = seen_from(x, y, heading, goal[0], goal[1], goal[2])
    for n in range(WORDS):
        work.words[n] = word(n, ahead, left, turn, floor.radius)[0]
    for _ in range(tries):
        n = int(np.argmin(work.words))
        length = work.words[n]
        if so_far + length >= best[0]:
            break
        work.words[n] = np.inf
        parts = word(n, ahead, left, turn, floor.radius)[1:]
        for k in range(waits + 1):
            best, free = _try_curve(
                i, node, n, length, parts, k * step_time, best, price, step_time, traffic, floor, work
            )
            if not free or so_far + length + (k + 1) * step_time >= best[0]:
                break
    return best


@inline
def _append(route, count, t, x, y, heading, rate, bend, seconds):
    """Add a piece to a route, or lengthen its last one if that goes on so; return the number of pieces."""
    if count > 0 and route[count - 1, RATE] == rate and route[count - 1, BEND] == bend:
        route[count - 1, END] = t + seconds
        return count
    p = route[count]
    p[BEGIN], p[X], p[Y], p[HEADING], p[RATE], p[BEND], p[END] = t, x, y, heading, rate, bend, t + seconds
    return count + 1


@part
def _write(node, n, wait, goal, step_time, route, floor, work):
    """Write the pieces to a node, the wait there and the curve from there on; return how many; -1: no room."""
    depth = work.steps[node]
    if depth + SEGMENTS + 2 > route.shape[0]:
        return _NONE
    chain = work.queue  # no longer needed
    at = node
    for k in range(depth, -1, -1):
        chain[k] = at
        at = work.parents[at]
    count = 0
    for k in range(depth):
        a, move = work.nodes[chain[k]], work.moves[chain[k + 1]]
        bend = _BENDS[move] / floor.radius
        count = _append(route, count, k * step_time, a[0], a[1], a[2], _RATES[move], bend, step_time)
    x, y, heading, t = work.nodes[node, 0], work.nodes[node, 1], work.nodes[node, 2], depth * step_time
    if wait > 0.0:
        count = _append(route, count, t, x, y, heading, 0.0, 0.0, wait)
        t += wait
    ahead, left, turn = seen_from(x, y, heading, goal[0], goal[1], goal[2])
    parts = word(n, ahead, left, turn, floor.radius)[1:]
    for k in range(SEGMENTS):
        if abs(parts[k]) > 1e-9:
            bend, rate, seconds = TURNS[n, k] / floor.radius, 1.0 if parts[k] > 0.0 else -1.0, abs(parts[k])
            count = _append(route, count, t, x, y, heading, rate, bend, seconds)
            x, y, heading = rolled(x, y, heading, parts[k], bend)
            t += seconds
    if count == 0:
        count = _append(route, count, 0.0, x, y, heading, 0.0, 0.0, 0.0)
    return count


@kernel
def search(i, start, goal, price, most, fine, bound, stamp, traffic, floor, work, route):
    """Write the best route found for robot i into route float64[P, PIECE]; return (pieces, cost, nodes looked at).

    start, goal float64[3]; most: nodes that are looked at; bound: what it must cost less than; pieces -1: no route.
    The cost is the arrival [s] and `price` for each meeting. work.later has been written for the goal.
    """
    step_time = _TURN * floor.radius / fine
    nodes, capacity = work.nodes, work.parents.size
    x, y, heading = start[0], start[1], start[2]
    nodes[0, 0], nodes[0, 1], nodes[0, 2] = x, y, heading
    ahead, left, turn = seen_from(x, y, heading, goal[0], goal[1], goal[2])
    nodes[0, 3] = distance(ahead, left, turn, floor.radius)
    work.steps[0], work.costs[0], work.parents[0], work.moves[0] = 0, 0, _NONE, _NONE
    size, used, looked = push(work.keys, work.queue, 0, nodes[0, 3], 0), 1, 0
    best = (bound, _NONE, _NONE, 0.0)
    deepest = int((traffic.first.shape[0] - 2) / step_time)
    while size > 0 and looked < most:
        _, node, size = pop(work.keys, work.queue, size)
        node = np.int64(node)
        step, cost = work.steps[node], work.costs[node]
        if step * step_time + price * cost + nodes[node, 3] >= best[0] - 1e-6:
            continue
        x, y, heading = nodes[node, 0], nodes[node, 1], nodes[node, 2]
        slot, key = _slot_of(x, y, heading, step, fine, stamp, work)
        if work.stamps[slot] == stamp and work.best[slot] < cost:
            continue
        looked += 1
        tries, waits = (_ROOT_TRIES, _ROOT_WAITS) if looked == 1 else (_TRIES, 0)
        best = _try_curves(i, node, goal, best, tries, waits, price, step_time, traffic, floor, work)
        if step >= deepest:
            continue
        for move in range(MOVES):
            rate, bend = _RATES[move], _BENDS[move] / floor.radius
            nx, ny, nh = rolled(x, y, heading, rate * step_time, bend)
            slot, key = _slot_of(nx, ny, nh, step + 1, fine, stamp, work)
            if work.stamps[slot] == stamp and work.best[slot] <= cost:
                continue
            ahead, left, turn = seen_from(nx, ny, nh, goal[0], goal[1], goal[2])
            to_go = distance(ahead, left, turn, floor.radius) if rate != 0.0 else nodes[node, 3]
            after = (step + 1) * step_time
            room = best[0] - 1e-6 - (after + to_go + price * cost)
            if room <= 0.0:
                continue
            if rate != 0.0 and not is_free(x, y, heading, rate * step_time, bend, floor):
                continue
            limit = 1 << 20 if room == np.inf else int(room / price) + 1
            met = cost + meetings(
                i, x, y, heading, rate, bend, step * step_time, step_time, limit, traffic, floor
            )
            if after + to_go + price * met >= best[0] - 1e-6:
                continue
            if (work.stamps[slot] == stamp and work.best[slot] <= met) or used == capacity:
                continue
            work.stamps[slot], work.taken[slot], work.best[slot] = stamp, key, met
            nodes[used, 0], nodes[used, 1], nodes[used, 2], nodes[used, 3] = nx, ny, nh, to_go
            work.steps[used], work.costs[used] = step + 1, met
            work.parents[used], work.moves[used] = node, move
            size = push(work.keys, work.queue, size, after + _GREED * to_go + price * met, used)
            used += 1
    if best[1] == _NONE:
        return _NONE, best[0], looked
    return _write(best[1], best[2], best[3], goal, step_time, route, floor, work), best[0], looked
