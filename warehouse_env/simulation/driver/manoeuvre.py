"""Manoeuvres: a search over (x, y, heading) for forward and backward arcs that the exact body can drive.

Hybrid-state A* (Dolgov et al. 2010): a node is a real pose. A cell of (x, y, heading) keeps only its soonest node. The
cost is the time for driving, steering and stopping. The heuristic to goal poses is the turning metric (turning.py). The
search for distant room uses the field of distances to room (room_field.py); the search for room near by uses none.

    count, margin = search(query, arcs, shots)

query: see Query. Contact at the start pose is ignored; contact after it is not. Each try keeps a smaller margin and has
shorter arcs than the one before, and the last one has more nodes; a node takes about 1.5 us. A try that is cut off ends
the search, unless `most` is MOST.
arcs float32[ARCS, 2]: filled with (signed length [m], steering [rad]) of each arc in turn.
shots: None unless the kind of goals may be EXACTLY. Such a search ends with a shot from a near pose (shots.py).
Returns the number of arcs, 0 if the start is a goal, NONE if nothing is found; and the margin [m]. A manoeuvre of more
than ARCS arcs ends there; all of it is free, and the next search starts at its end. `search_once` is a single try: it
returns CUT_OFF if `most` nodes do not decide.
"""

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, part, whole
from warehouse_env.simulation.driver import turning
from warehouse_env.simulation.driver.bodies import arc_is_free, bars, write_rooms
from warehouse_env.simulation.driver.room_field import UNKNOWN, apart_of, room_at, write_room
from warehouse_env.simulation.driver.scratch import COSINE, COST, HEADING, MARGIN, MOST, SINE, WAITING, X, Y
from warehouse_env.simulation.driver.shots import shoot
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import Pose, body_of, grown
from warehouse_env.simulation.physics.trigonometry import ZERO, sin_cos, wrap

NONE, CUT_OFF = -1, -2  # found: see above
OFF, FAR_OFF, ROUGHLY, EXACTLY = range(
    4
)  # kinds of goals: off `avoid`, near by or at any distance; close to a pose, or exactly at one
ARCS = 16  # of a manoeuvre at most
TRIES = 6  # the first is coarse: it finds a way around a body or a turn with a tenth of the nodes
# [m] to shelves and bodies, of each try. A robot drives with a third of that (driving.KEPT), so where a deviation stops
# it, the next search can begin.
MARGINS = tuple(np.float32(m) for m in (0.03, 0.03, 0.008, 0.002, 0.0005, 0.0005))
STRIDES = (np.float32(0.4), turning.STRIDE, *(np.float32(m) for m in (0.2, 0.15, 0.15, 0.06)))  # [m] of an arc
CELLS = tuple(np.float32(m) for m in (0.4, 0.1, 0.067, 0.05, 0.05, 0.02))  # [m], of (x, y)
NODES = (6000,) * 5 + (MOST,)  # at most; with 6,000, the last one left robots wedged beside shelves for minutes
TOO_NEAR = np.float32(5e-5)  # [m] for arcs that begin nearer: more than the exact follower keeps
GREED = np.float32(1.1)  # weight of the heuristic: found soon rather than best
_HEADINGS = 36  # cells of 10 degrees
_SHOTS = 4  # an exact search tries a shot from every so many nodes
_SHOT_WITHIN = np.float32(12.0)  # [s], largest estimate of the rest
_TWICE, _SPARE = np.float32(2.0), np.float32(4.0)  # a shot may take so many times as long, and [s] longer
_REACHED, _ALONG = np.float32(0.1), np.float32(0.15)  # [m] beside and along a goal pose that count as there
_ALIGNED = np.float32(0.2)  # [rad]
_LARGE = np.float32(2.0)  # times that for longer bodies at most: the end of a route is a goal that is arrived at


class Query(NamedTuple):
    """What to search for, from where, and how long."""

    pose: Any  # Pose of the robot
    steer: Any  # [rad], the present steering angle
    kind: Any  # of goals: OFF, FAR_OFF, ROUGHLY or EXACTLY
    near: Any  # float32[G, GOAL]: poses, and the seconds from there on (put_goal); the least total time wins
    far: Any  # float32[H, GOAL]: other goals, if any; each try searches for them after `near`
    around: Any  # SearchArea
    tries: Any  # TRIES at most
    most: Any  # nodes of each try, MOST at most
    scratch: Any


@inline
def put_goal(goals, k, x, y, heading, seconds):
    """Write a goal pose into goals[k], and the seconds [s] of the rest of the way."""
    goals[k, X], goals[k, Y], goals[k, HEADING], goals[k, COST] = x, y, heading, seconds
    goals[k, SINE], goals[k, COSINE] = sin_cos(heading)


@inline
def _margin_at(pose, margin, around):
    """Return the margin [m] to shelves of arcs from a pose: TOO_NEAR where the body there is nearer than that."""
    body = grown(body_of(pose.x, pose.y, pose.c, pose.s, around.p), margin)
    return TOO_NEAR if body_touches_shelf(body, around.floor) else margin


@inline
def _to_go(pose, goals, around):
    """Return (whether a goal is reached, seconds from there on; or estimated seconds to the best goal)."""
    least, arrived, long, large = (
        np.float32(np.inf), False, around.p["length_scale"], min(around.p["length_scale"], _LARGE),
    )  # fmt: skip
    for k in range(goals.shape[0]):
        c, s, after = goals[k, COSINE], goals[k, SINE], goals[k, COST]
        dx, dy, turn = pose.x - goals[k, X], pose.y - goals[k, Y], wrap(pose.heading - goals[k, HEADING])
        ahead, left = dx * c + dy * s, dy * c - dx * s
        if abs(ahead) <= _ALONG * large and abs(left) <= _REACHED * large and abs(turn) <= _ALIGNED:
            least, arrived = (min(least, after) if arrived else after), True
        elif not arrived:
            way = turning.seconds_between(ahead, left, turn, around.metric, turning.CELL * long)
            least = min(least, after + GREED * way)
    return arrived, least


@inline
def _off(pose, query):
    """Return (whether the body is off `avoid`, lower bound of the seconds until it is); inf if it never is."""
    around, way = query.around, ZERO
    if query.kind == FAR_OFF:
        back, start = around.p["offset"], query.pose
        x0, y0 = start.x - back * start.c, start.y - back * start.s
        way = room_at(pose.x - back * pose.c, pose.y - back * pose.s, x0, y0, query.scratch.room, apart_of(around.p))
    if way >= UNKNOWN:
        return False, np.float32(np.inf)
    return way == ZERO and not bars(pose, around), GREED * way / turning.FORWARD_SPEED


@inline
def _slot_of(pose, cell, cells):
    """Return (slot, key) of the pose's cell [m] in the hash table: the slot holds this key or is free."""
    taken = cells.keys
    column, row = int(np.floor(pose.x / cell)) & 0x3FF, int(np.floor(pose.y / cell)) & 0x3FF
    key = ((column << 10) | row) * 64 + turning.heading_cell(pose.heading, _HEADINGS) + 1
    slot = ((key * 0x9E3779B1) >> 18) & (taken.size - 1)  # Fibonacci hashing, Knuth, vol. 3, 6.4
    while taken[slot] != 0 and taken[slot] != key:
        slot = (slot + 1) & (taken.size - 1)
    return slot, key


@inline
def _write_arcs(node, scratch, arcs):
    """Write the arcs that lead to a node, equal ones as one, from the start on; return their number."""
    parents, by, moves = scratch.nodes.parents, scratch.nodes.by, scratch.moves
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
def _pose_of(node, nodes):
    at = nodes.poses[node]
    return Pose(at[X], at[Y], at[HEADING], at[COSINE], at[SINE])


@inline
def _after(node, k, query):
    """Return (pose, seconds from the start on) at the end of move k from a node."""
    nodes, move = query.scratch.nodes, query.scratch.moves[k]
    pose, before = _pose_of(node, nodes), nodes.by[node]
    length, last = ZERO, query.steer
    if before >= 0:
        length, last = query.scratch.moves[before, turning.LENGTH], query.scratch.moves[before, turning.STEER]
    change = turning.change_time(length, last, move[turning.LENGTH], move[turning.STEER], query.around.p)
    end = Pose(
        pose.x + move[turning.AHEAD] * pose.c - move[turning.LEFT] * pose.s,
        pose.y + move[turning.AHEAD] * pose.s + move[turning.LEFT] * pose.c,
        wrap(pose.heading + move[turning.TURN]),
        pose.c * move[turning.COS] - pose.s * move[turning.SIN],
        pose.s * move[turning.COS] + pose.c * move[turning.SIN],
    )
    return end, nodes.poses[node, COST] + move[turning.SECONDS] + change


@inline
def _keep(node, pose, seconds, margin, nodes):
    """Write the pose, cost and margin of a node."""
    at = nodes.poses[node]
    at[X], at[Y], at[HEADING], at[COSINE], at[SINE] = pose.x, pose.y, pose.heading, pose.c, pose.s
    at[COST], at[MARGIN] = seconds, margin


@inline
def _begin(query, goals, trial):
    """Start a try at the robot's pose; return whether that pose is a goal."""
    scratch, around, pose, margin = query.scratch, query.around, query.pose, MARGINS[trial]
    turning.write_moves(STRIDES[trial] * around.p["length_scale"], around.p, scratch.moves)
    write_rooms(pose, margin, around)
    scratch.cells.keys[:] = 0
    _keep(0, pose, ZERO, _margin_at(pose, margin, around), scratch.nodes)
    scratch.nodes.parents[0], scratch.nodes.by[0] = -1, -1
    if query.kind <= FAR_OFF:
        return not bars(pose, around)
    return query.kind == ROUGHLY and _to_go(pose, goals, around)[0]


@inline
def _branch(node, size, waiting, cell, most, query, goals):
    """Queue the moves from a node; return (size of the heap, moves so far, or CUT_OFF if the queue is full).

    Moves are checked against obstacles only when they are taken: most never are.
    """
    queue, cells = query.scratch.queue, query.scratch.cells
    for k in range(turning.MOVES):
        pose, seconds = _after(node, k, query)
        slot, key = _slot_of(pose, cell, cells)
        if cells.keys[slot] == key and cells.seconds[slot] <= seconds:
            continue
        if waiting == most * WAITING:
            return size, CUT_OFF
        ends, rest = _off(pose, query) if query.kind <= FAR_OFF else _to_go(pose, goals, query.around)
        if rest == np.inf:
            continue
        queue.origins[waiting], queue.moves[waiting], queue.ends[waiting] = node, k, ends
        size = push(queue.keys, queue.items, size, seconds + rest, waiting)
        waiting += 1
    return size, waiting


@inline
def _take(size, used, cell, margin, most, query):
    """Take the soonest free move from the queue and store its end as node `used`; return (move, size of the heap).

    Instead of the move: NONE if no move is free, CUT_OFF if there is no space for a node.
    """
    nodes, queue, cells = query.scratch.nodes, query.scratch.queue, query.scratch.cells
    while size > 0:
        _, entry, size = pop(queue.keys, queue.items, size)
        node, k = whole(queue.origins[entry]), queue.moves[entry]
        pose, seconds = _after(node, k, query)
        slot, key = _slot_of(pose, cell, cells)
        if cells.keys[slot] == key and cells.seconds[slot] <= seconds:
            continue
        move, kept = query.scratch.moves[k], nodes.poses[node, MARGIN]
        if not arc_is_free(_pose_of(node, nodes), move[turning.BEND], move[turning.LENGTH], kept, query.around):
            continue
        if used == most:
            return whole(CUT_OFF), size
        cells.keys[slot], cells.seconds[slot] = key, seconds
        _keep(used, pose, seconds, margin if kept == margin else _margin_at(pose, margin, query.around), nodes)
        nodes.parents[used], nodes.by[used] = node, k
        return whole(entry), size
    return whole(NONE), size


@part
def _finish(node, query, goals, arcs):
    """Write the arcs to a goal by a shot from a node; return their number, -1 if no shot is tried or free."""
    nodes, moves, shot = query.scratch.nodes, query.scratch.moves, query.scratch.shot
    pose = _pose_of(node, nodes)
    rest = _to_go(pose, goals, query.around)[1]
    if node % _SHOTS != 0 or rest > _SHOT_WITHIN:
        return -1
    last = moves[nodes.by[node], turning.STEER] if nodes.by[node] >= 0 else query.steer
    more, _ = shoot(pose, last, goals, nodes.poses[node, MARGIN], _TWICE * rest + _SPARE, query.around, shot)
    if more < 0:
        return -1
    count = _write_arcs(node, query.scratch, arcs)
    more = min(more, arcs.shape[0] - count)
    for k in range(more):
        arcs[count + k, 0], arcs[count + k, 1] = shot[k, 0], shot[k, 1]
    return count + more


@part
def search_once(query, goals, trial, arcs, shots):
    """Run try `trial` of TRIES for these goals of the query; return the number of arcs, NONE or CUT_OFF."""
    if _begin(query, goals, trial):
        return 0
    cell, most = CELLS[trial] * query.around.p["length_scale"], min(query.most, NODES[trial])
    size, waiting, used = 0, 0, whole(1)
    while True:
        size, waiting = _branch(used - 1, size, waiting, cell, most, query, goals)
        if waiting == CUT_OFF:
            return CUT_OFF
        entry, size = _take(size, used, cell, MARGINS[trial], most, query)
        if entry < 0:
            return entry
        if query.kind != EXACTLY:
            if query.scratch.queue.ends[entry]:
                return _write_arcs(used, query.scratch, arcs)
        elif shots is not None:
            count = _finish(used, query, goals, arcs)
            if count >= 0:
                return count
        used += 1


@part
def search(query, arcs, shots):
    """Find a manoeuvre and write it into `arcs`; return (number of arcs, margin [m]): see above."""
    if query.kind == FAR_OFF:
        write_room(query.pose, query.around, query.scratch)
    for k in range(query.tries):  # without bodies, ways are short: the coarse try comes second
        trial = 1 - k if k < 2 and query.around.bodies.shape[0] == 0 else k
        for far in range(2 if query.far.shape[0] > 0 else 1):
            count = search_once(query, query.far if far else query.near, trial, arcs, shots)
            if count >= 0:
                return count, MARGINS[trial]
            if count == CUT_OFF and query.most < MOST:  # narrower margins mean more nodes
                return NONE, ZERO
    return NONE, ZERO
