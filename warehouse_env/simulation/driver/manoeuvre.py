"""Manoeuvres: a search over (x, y, heading) for arcs, forwards and backwards, that the exact body can drive.

Hybrid-state A* (Dolgov et al. 2010): a node is a real pose, and of the nodes in a cell of (x, y, heading) the soonest
counts. The cost is the time that driving, steering and stopping take. The heuristic to goals is the turning metric,
which knows how the body turns (turning.py). Room near by is searched for without one; a search for room that may take
MOST nodes has the field of how far room is, which knows what stands around (room_field.py).

API, for any kernel of the simulation (nothing is drawn at random, nothing kept between calls):

    count, margin = search(x, y, heading, steer, goals, avoid, bodies, most, p, floor, metric, arcs)

x, y, heading, steer: the robot's pose [m], [rad] and its present steering angle [rad]; it may stand too near to
    something: what touches at the start does not count, what touches after it does.
goals float32[G, 4]: poses x, y, heading to be reached, and the seconds that it takes from there on; the search ends at
    whatever is soonest in all. G = 0: make room, i.e. end where the body keeps off all rectangles of `avoid`.
avoid float32[K, BODY]: rectangles (columns: bodies.py) to be off in the end; not read if there are goals.
bodies float32[K, BODY]: rectangles that stand still, to be kept off all the way, by the field's margin as well.
most: nodes of each of TRIES, each nearer to shelves and bodies and with shorter arcs than the one before; some 1.5 us a
    node. After one that was cut off there is no other, unless `most` is MOST.
p, floor: PARAMETERS record and the floor; metric: turning_metric(PARAMETERS[1]), made once a Simulator.
arcs float32[ARCS, 2]: is filled with (signed length [m], steering [rad]) of one arc after the other.
search_once(..., goals, leave, bodies, trial, most, ...): a single try; leave: `avoid`, and the field of how far room
    is, float32[0, 0] if there is none.
search_exact(..., bodies, trial, most, ...): a single try whose goals are reached exactly, by a shot (shots.py) from a
    pose near enough: analytic expansion (Dolgov et al. 2010).
Returns the number of arcs, 0 if the start is a goal already, NONE if there is none (search_once: CUT_OFF if there may
be, but not within `most` nodes), and search also the margin [m] that it keeps. A manoeuvre of more than ARCS arcs is
cut off there; it is all free, and the next search begins at its end.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.simulation.driver import turning
from warehouse_env.simulation.driver.bodies import BODY, bars, clear_of_bodies, write_rooms
from warehouse_env.simulation.driver.room_field import UNKNOWN, apart_of, room_around, room_at
from warehouse_env.simulation.driver.shots import MOST_ARCS, shoot
from warehouse_env.simulation.physics.footprint import body_touches_shelf, sweep_is_free
from warehouse_env.simulation.physics.geometry import body_of, grown
from warehouse_env.simulation.physics.trigonometry import ZERO, sin_cos, wrap

NONE, CUT_OFF = -1, -2  # found: see above
ARCS = 16  # of a manoeuvre at most
MOST = 6000  # nodes of a search
_WAITING = 8  # times as many moves that may wait in its queue
TRIES = 6  # the first is coarse: it finds a way round another body, or to turn round, within a tenth of the nodes
# [m] to shelves and bodies, of each try. A robot drives with a third of that (driving.py): where deviation stops it,
# the next try can begin.
MARGINS = tuple(np.float32(m) for m in (0.03, 0.03, 0.008, 0.002, 0.0005, 0.0005))
STRIDES = (np.float32(0.4), turning.STRIDE, *(np.float32(m) for m in (0.2, 0.15, 0.15, 0.06)))  # [m] of an arc
CELLS = tuple(np.float32(m) for m in (0.4, 0.1, 0.067, 0.05, 0.05, 0.02))  # [m], of (x, y)
TOO_NEAR = np.float32(5e-5)  # [m] of arcs that begin nearer: more than the follower keeps where it is exact
GREED = np.float32(1.1)  # how much the heuristic weighs: soon found before best
_HEADINGS = 36  # cells of 10 degrees
_SLOTS = 1 << 14  # of the table of cells, more than twice MOST
_SHORT, _SHORT_SLOTS = 300, 1 << 10  # nodes of a short search, no fewer than rejoin.AMONG_OTHERS, and slots for them
_SHOTS = 4  # nodes of an exact search from one of which a shot is tried,
_SHOT_WITHIN = np.float32(12.0)  # [s] of way to go at most
_TWICE, _SPARE = np.float32(2.0), np.float32(4.0)  # times as long, and [s] longer, that a shot may take
_REACHED, _ALONG = np.float32(0.1), np.float32(0.15)  # [m] beside and along a goal pose that count as there
_ALIGNED = np.float32(0.2)  # [rad]
_LARGE = np.float32(2.0)  # times that for longer bodies at most: the end of a route is a goal that is arrived at
X, Y, HEADING, COSINE, SINE, COST, MARGIN = range(7)  # columns of `poses`; MARGIN: of arcs from there [m]


@inline
def _margin_at(x, y, c, s, margin, p, floor):
    """Return the margin [m] to shelves of arcs from a pose: TOO_NEAR where the body there is nearer than that."""
    body = grown(body_of(x, y, c, s, p), margin)
    return TOO_NEAR if body_touches_shelf(body, floor) else margin


@inline
def _to_go(x, y, heading, goals, facing, metric, p):
    """Return (whether a goal is reached, seconds from there on; or estimated seconds to the best goal).

    facing float32[G, 2]: cosine and sine of the goals' headings.
    """
    least, arrived, large = np.float32(np.inf), False, min(p["long"], _LARGE)
    for k in range(goals.shape[0]):
        c, s = facing[k, 0], facing[k, 1]
        dx, dy, turn = x - goals[k, 0], y - goals[k, 1], wrap(heading - goals[k, 2])
        ahead, left = dx * c + dy * s, dy * c - dx * s
        if abs(ahead) <= _ALONG * large and abs(left) <= _REACHED * large and abs(turn) <= _ALIGNED:
            least, arrived = (min(least, goals[k, 3]) if arrived else goals[k, 3]), True
        elif not arrived:
            least = min(
                least,
                goals[k, 3] + GREED * turning.seconds_between(ahead, left, turn, metric, turning.CELL * p["long"]),
            )
    return arrived, least


@inline
def _slot_of(x, y, heading, cell, taken):
    """Return (slot, key) of the pose's cell in the table `taken` int32[_SLOTS]: where its key stands, or may stand."""
    column, row = int(np.floor(x / cell)) & 0x3FF, int(np.floor(y / cell)) & 0x3FF
    key = ((column << 10) | row) * 64 + turning.heading_cell(heading, _HEADINGS) + 1
    slot = ((key * 0x9E3779B1) >> 18) & (taken.size - 1)  # Fibonacci hashing, Knuth, vol. 3, 6.4
    while taken[slot] != 0 and taken[slot] != key:
        slot = (slot + 1) & (taken.size - 1)
    return slot, key


@inline
def _write_arcs(node, parents, by, moves, arcs):
    """Write the arcs that lead to a node, equal ones as one, from the start on; return their number."""
    count, last, at = 0, -1, node
    while parents[at] >= 0:  # how many there are
        count += by[at] != last
        last = by[at]
        at = parents[at]
    place, last, at = count, -1, node
    while parents[at] >= 0:
        if by[at] != last:
            place -= 1
            last = by[at]
            if place < arcs.shape[0]:
                arcs[place, 0], arcs[place, 1] = ZERO, moves[last, turning.STEER]
        if place < arcs.shape[0]:
            arcs[place, 0] += moves[last, turning.LENGTH]
        at = parents[at]
    return min(count, arcs.shape[0])


@inline
def _after(poses, node, move):
    """Return the pose (x, y, heading, cosine, sine) at the end of a move from a node."""
    c, s = poses[node, COSINE], poses[node, SINE]
    x = poses[node, X] + move[turning.AHEAD] * c - move[turning.LEFT] * s
    y = poses[node, Y] + move[turning.AHEAD] * s + move[turning.LEFT] * c
    heading = wrap(poses[node, HEADING] + move[turning.TURN])
    return x, y, heading, c * move[turning.COS] - s * move[turning.SIN], s * move[turning.COS] + c * move[turning.SIN]


@inline
def _is_free(poses, node, move, bodies, rooms, p, floor):
    """Whether a move from a node keeps off shelves and bodies."""
    x, y, c, s = poses[node, X], poses[node, Y], poses[node, COSINE], poses[node, SINE]
    bend, length = move[turning.BEND], move[turning.LENGTH]
    return sweep_is_free(x, y, c, s, bend, length, poses[node, MARGIN], p, floor) and clear_of_bodies(
        x, y, c, s, bend, length, bodies, rooms, p
    )


@inline
def _seconds(poses, node, steer, by, move, moves, p):
    """Return the seconds to the end of a move from a node; steer [rad]: the steering angle at the start."""
    before = by[node]
    length, last = (moves[before, turning.LENGTH], moves[before, turning.STEER]) if before >= 0 else (ZERO, steer)
    change = turning.change_time(length, last, move[turning.LENGTH], move[turning.STEER], p)
    return poses[node, COST] + move[turning.SECONDS] + change


@part
def _finish(poses, node, steer, parents, by, moves, goals, facing, bodies, rooms, exact, p, floor, metric, arcs):
    """Return the number of arcs to a goal over a node, -1 if no shot is tried from there or none is free."""
    x, y, heading = poses[node, X], poses[node, Y], poses[node, HEADING]
    rest = _to_go(x, y, heading, goals, facing, metric, p)[1]
    if node % _SHOTS != 0 or rest > _SHOT_WITHIN:
        return -1
    last = moves[by[node], turning.STEER] if by[node] >= 0 else steer
    more, _ = shoot(
        x, y, heading, last, goals, poses[node, MARGIN], _TWICE * rest + _SPARE, bodies, rooms, p, floor,
        exact,
    )  # fmt: skip
    if more < 0:
        return -1
    count = _write_arcs(node, parents, by, moves, arcs)
    for k in range(min(more, arcs.shape[0] - count)):
        arcs[count, 0], arcs[count, 1] = exact[k, 0], exact[k, 1]
        count += 1
    return count


@part
def _search(
    x, y, heading, steer, goals, facing, leave, bodies, rooms, margin, stride, cell, tree, table, queue, exact,
    p, floor, metric, arcs,
):  # fmt: skip
    """Search as search_once does, or search_exact if `exact` (float32[MOST_ARCS, 2], else None), with its arrays.

    Moves wait in the queue unseen: whether one is free is looked at when it is the soonest, for most never are.
    """
    moves, poses, parents, by = tree
    taken, best = table
    keys, items, origins, ways, ends = queue
    avoid, room = leave
    turning.write_moves(stride, p, moves)
    aside, capacity = goals.shape[0] == 0, keys.size
    s, c = sin_cos(heading)
    x0, y0 = x - p["offset"] * c, y - p["offset"] * s
    write_rooms(x, y, c, s, margin, bodies, p, rooms)
    poses[0, X], poses[0, Y], poses[0, HEADING], poses[0, COSINE], poses[0, SINE] = x, y, heading, c, s
    poses[0, COST], poses[0, MARGIN] = ZERO, _margin_at(x, y, c, s, margin, p, floor)
    parents[0], by[0] = -1, -1
    if exact is None and (
        (not bars(x, y, c, s, avoid, p)) if aside else _to_go(x, y, heading, goals, facing, metric, p)[0]
    ):
        return 0
    size, waiting, used, node = 0, 0, 1, whole(0)
    while True:
        for k in range(turning.MOVES):
            x, y, heading, c, s = _after(poses, node, moves[k])
            total = _seconds(poses, node, steer, by, moves[k], moves, p)
            slot, key = _slot_of(x, y, heading, cell, taken)
            if taken[slot] == key and best[slot] <= total:
                continue
            if waiting == capacity:
                return CUT_OFF
            rest, ends[waiting] = ZERO, False
            if aside:
                if room.size > 0:
                    way = room_at(x - p["offset"] * c, y - p["offset"] * s, x0, y0, room, apart_of(p))
                    if way >= UNKNOWN:
                        continue
                    rest = GREED * way / turning.FORWARD_SPEED
                ends[waiting] = rest == ZERO and not bars(x, y, c, s, avoid, p)
            else:
                ends[waiting], rest = _to_go(x, y, heading, goals, facing, metric, p)
            origins[waiting], ways[waiting] = node, k
            size = push(keys, items, size, total + rest, waiting)
            waiting += 1
        found = False
        while size > 0 and not found:
            _, entry, size = pop(keys, items, size)
            node, k = whole(origins[entry]), ways[entry]
            x, y, heading, c, s = _after(poses, node, moves[k])
            total = _seconds(poses, node, steer, by, moves[k], moves, p)
            slot, key = _slot_of(x, y, heading, cell, taken)
            if not (taken[slot] == key and best[slot] <= total):
                found = _is_free(poses, node, moves[k], bodies, rooms, p, floor)
        if not found:
            return NONE
        if used == parents.size:
            return CUT_OFF
        taken[slot], best[slot] = key, total
        kept = poses[node, MARGIN]
        poses[used, X], poses[used, Y], poses[used, HEADING], poses[used, COSINE], poses[used, SINE] = (
            x,
            y,
            heading,
            c,
            s,
        )
        poses[used, COST] = total
        poses[used, MARGIN] = margin if kept == margin else _margin_at(x, y, c, s, margin, p, floor)
        parents[used], by[used] = node, k
        node = used
        used += 1
        if exact is not None:
            count = _finish(
                poses,
                node,
                steer,
                parents,
                by,
                moves,
                goals,
                facing,
                bodies,
                rooms,
                exact,
                p,
                floor,
                metric,
                arcs,
            )
            if count >= 0:
                return count
        elif ends[entry]:
            return _write_arcs(node, parents, by, moves, arcs)


@kernel
def _search_within(x, y, heading, steer, goals, leave, bodies, trial, most, slots, exact, p, floor, metric, arcs):
    """Search as `_search` does, in arrays for `most` nodes and a table of `slots` cells, a power of two."""
    tree = (
        np.empty((turning.MOVES, 9), np.float32), np.empty((most, 7), np.float32), np.empty(most, np.int32),
        np.empty(most, np.int8),
    )  # fmt: skip
    table, many = (np.zeros(slots, np.int32), np.empty(slots, np.float32)), most * _WAITING
    queue = (
        np.empty(many, np.float32), np.empty(many, np.int32), np.empty(many, np.int32), np.empty(many, np.int8),
        np.empty(many, np.bool_),
    )  # fmt: skip
    rooms, facing = np.empty(bodies.shape[0], np.float32), np.empty((goals.shape[0], 2), np.float32)
    for k in range(goals.shape[0]):
        facing[k, 1], facing[k, 0] = sin_cos(goals[k, 2])
    return _search(
        x, y, heading, steer, goals, facing, leave, bodies, rooms, MARGINS[trial],
        STRIDES[trial] * p["long"], CELLS[trial] * p["long"],
        tree, table, queue, exact, p, floor, metric, arcs,
    )  # fmt: skip


@kernel
def no_leave():
    """Return what a search for goals takes as `leave`."""
    return np.empty((0, BODY), np.float32), np.empty((0, 0), np.float32)


@kernel
def search_once(x, y, heading, steer, goals, leave, bodies, trial, most, p, floor, metric, arcs):
    """Search as in try `trial` of TRIES, for at most `most` <= MOST nodes; return as `search` does.

    Most searches are short, so the arrays are small at first: to make large ones takes longer than such a search.
    """
    count = CUT_OFF
    for large in range(2):
        nodes, slots = (most, _SLOTS) if large else (min(most, _SHORT), _SHORT_SLOTS)
        count = _search_within(
            x, y, heading, steer, goals, leave, bodies, trial, nodes, slots, None, p, floor, metric, arcs
        )
        if count != CUT_OFF or nodes == most:
            break
    return count


@kernel
def search_exact(x, y, heading, steer, goals, bodies, trial, most, p, floor, metric, arcs):
    """Search as search_once does, for a way that ends exactly at one of the goals."""
    exact = np.empty((MOST_ARCS, 2), np.float32)
    return _search_within(
        x, y, heading, steer, goals, no_leave(), bodies, trial, most, _SLOTS, exact, p, floor, metric, arcs
    )


@inline
def trial_of(k, bodies):
    """Return which of TRIES is the k-th: alone, where short ways are the rule, the coarse one is the second."""
    return 1 - k if k < 2 and bodies.shape[0] == 0 else k


@kernel
def search(x, y, heading, steer, goals, avoid, bodies, most, p, floor, metric, arcs):
    """Find a manoeuvre and write it into `arcs`; return the number of its arcs and its margin (see above)."""
    room = no_leave()[1]
    if goals.shape[0] == 0 and most == MOST:
        room = room_around(x, y, heading, avoid, bodies, p, floor)
    leave = avoid, room
    for k in range(TRIES):
        trial = trial_of(k, bodies)
        count = search_once(x, y, heading, steer, goals, leave, bodies, trial, most, p, floor, metric, arcs)
        if count >= 0:
            return count, MARGINS[trial]
        if count == CUT_OFF and most < MOST:  # among narrower ways there are more
            break
    return NONE, ZERO
