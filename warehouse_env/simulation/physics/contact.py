"""Trial motion, exact contact, put-back.

All robots move at once. A robot that touches something, at the end of the substep or on the way (sweep.py), is put back
to its start with zero speed. This repeats until nothing overlaps; at worst, no robot moves. So no body ever overlaps
another. The shield has already checked the way; under it, only the ends are checked. contact_episodes.py counts.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.buckets import CENTRE_X, CENTRE_Y, bucket_at
from warehouse_env.simulation.physics.footprint import (
    body_touches_shelf,
    clearance_at,
    disc_room,
    meets_obstacle,
    touches_obstacle,
)
from warehouse_env.simulation.physics.geometry import body_of, grown, rectangles_touch, separation, squared_distance
from warehouse_env.simulation.physics.kinds import kind_of, many_alike
from warehouse_env.simulation.physics.kinematics import (
    arc_driven,
    chassis_of,
    curvature,
    drive,
    next_motion,
    way_driven,
)
from warehouse_env.simulation.physics.sweep import Sweep, touch_between, turns_back
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, sin_cos

# Rows of `motion` float32[MOTION, N], the motion within one physics step: the present pose, what changes it, the trial
# pose, the longest path [m] of any point of the body to there, and the least room [m] to the nearest shelf.
X, Y, HEADING, COS, SIN, SPEED, STEER, ACCELERATION, STEER_RATE = range(9)
TRY_X, TRY_Y, TRY_HEADING, TRY_COS, TRY_SIN, WAY, ROOM = range(9, 16)
MOTION = 16
# `lanes` float32[MOTION x LANES] holds LANES robots of `motion` at constant strides, so that the compiler sees that no
# rows overlap. MOVES takes the place of the room.
LANES, MOVES = 8, ROOM
# Rows of `flags` int32[FLAGS, N]: the trial pose differs from the present one; the robot must be put back
MOVING, BLOCKED = 0, 1
FLAGS = 2


def scratch(count: int, p: Any) -> tuple[NDArray[Any], ...]:
    """Return a world's arrays: pairs int32[P, 3], motion float32[MOTION, N], flags int32[FLAGS, N] and lanes."""
    pairs, lanes = np.empty((p["most_pairs"], 3), np.int32), np.zeros(MOTION * LANES, np.float32)
    return pairs, np.empty((MOTION, count), np.float32), np.empty((FLAGS, count), np.int32), lanes


@inline
def list_pairs(bodies, order, starts, p, pairs):
    """Write the pairs (i, j, touched = 0), j < i, that could meet within a physics step; return their number.

    bodies, order, starts: see buckets.sort.
    """
    count = 0
    reach, columns = p["pair_range"], p["bucket_columns"]
    for n in range(bodies.shape[1]):
        cx, cy = bodies[CENTRE_X, n], bodies[CENTRE_Y, n]
        row, column = bucket_at(cx, cy, p)
        left, right = max(column - 1, 0), min(column + 2, columns)
        for by in range(max(row - 1, 0), row + 1):
            # each pair once: of the own row and the one below, those that come before in the order
            for m in range(starts[by * columns + left], min(starts[by * columns + right], n)):
                dx, dy = bodies[CENTRE_X, m] - cx, bodies[CENTRE_Y, m] - cy
                if dx * dx + dy * dy < reach * reach and count < pairs.shape[0]:
                    pairs[count, 0] = max(order[n], order[m])
                    pairs[count, 1] = min(order[n], order[m])
                    pairs[count, 2] = 0
                    count += 1
    return count


@inline
def load(robots, i, acceleration, steer_rate, p, floor, motion):
    """Load the MOTION of robot i, or body i, and its command [m/s^2], [rad/s] for a physics step into `motion`."""
    now = robots[i]["motion"]
    c, s = now["cos"], now["sin"]
    motion[X, i], motion[Y, i], motion[HEADING, i] = now["x"], now["y"], now["heading"]
    motion[COS, i], motion[SIN, i] = c, s
    motion[SPEED, i], motion[STEER, i] = now["speed"], now["steer"]
    motion[ACCELERATION, i], motion[STEER_RATE, i] = acceleration, steer_rate
    centre_x, centre_y = now["x"] - p["offset"] * c, now["y"] - p["offset"] * s
    motion[ROOM, i] = clearance_at(centre_x, centre_y, floor) - p["radius"]


@inline
def store(robots, motion):
    """Write the motion of a physics step back into the robots, or the bodies."""
    for i in range(robots.shape[0]):
        now = robots[i]["motion"]
        now["x"], now["y"], now["heading"] = motion[X, i], motion[Y, i], motion[HEADING, i]
        now["cos"], now["sin"] = motion[COS, i], motion[SIN, i]
        now["speed"], now["steer"] = motion[SPEED, i], motion[STEER, i]


@inline
def _drive_lanes(lanes, p):
    """Move the robots in `lanes` for a substep, on trial; without branches and calls, to use vector instructions."""
    dt, far, chassis = p["dt"], p["far"], chassis_of(p)
    for k in range(LANES):
        speed, steer = lanes[SPEED * LANES + k], lanes[STEER * LANES + k]
        acceleration, steer_rate = lanes[ACCELERATION * LANES + k], lanes[STEER_RATE * LANES + k]
        next_speed, next_steer = next_motion(speed, steer, acceleration, steer_rate, chassis, dt)
        x, y, heading = lanes[X * LANES + k], lanes[Y * LANES + k], lanes[HEADING * LANES + k]
        c, s = lanes[COS * LANES + k], lanes[SIN * LANES + k]
        to_x, to_y, to_heading = drive((x, y, heading), speed, next_speed, steer, next_steer, chassis, dt)
        to_s, to_c = sin_cos(to_heading)
        _, bend = arc_driven(speed, next_speed, steer, next_steer, chassis, dt)
        stands = (speed == ZERO) & (next_speed == ZERO)
        lanes[SPEED * LANES + k] = next_speed
        lanes[STEER * LANES + k] = next_steer
        lanes[TRY_X * LANES + k] = x if stands else to_x
        lanes[TRY_Y * LANES + k] = y if stands else to_y
        lanes[TRY_HEADING * LANES + k] = heading if stands else to_heading
        lanes[TRY_COS * LANES + k] = c if stands else to_c
        lanes[TRY_SIN * LANES + k] = s if stands else to_s
        lanes[WAY * LANES + k] = way_driven(speed, next_speed, bend, far, dt)
        lanes[MOVES * LANES + k] = ZERO if stands else ONE


@inline
def try_motion(motion, flags, lanes, p, kinds):
    """Move all robots for a substep, on trial (the TRY_ rows); speed and steering change permanently."""
    begin = 0
    while begin < motion.shape[1]:
        count = many_alike(begin, motion.shape[1], kinds, LANES)
        for row in range(TRY_X):
            for k in range(count):
                lanes[row * LANES + k] = motion[row, begin + k]
        _drive_lanes(lanes, kind_of(begin, p, kinds))
        for k in range(count):
            for row in range(SPEED, STEER + 1):
                motion[row, begin + k] = lanes[row * LANES + k]
            for row in range(TRY_X, WAY + 1):
                motion[row, begin + k] = lanes[row * LANES + k]
            flags[MOVING, begin + k] = lanes[MOVES * LANES + k] != ZERO
        begin += count


@inline
def put_back(motion, flags, i):
    """Stop robot i at its present pose."""
    motion[TRY_X, i], motion[TRY_Y, i], motion[TRY_HEADING, i] = motion[X, i], motion[Y, i], motion[HEADING, i]
    motion[TRY_COS, i], motion[TRY_SIN, i] = motion[COS, i], motion[SIN, i]
    motion[ROOM, i] -= motion[WAY, i]  # it may be that of the trial pose
    motion[SPEED, i], motion[WAY, i] = ZERO, ZERO
    flags[MOVING, i] = 0
    flags[BLOCKED, i] = 0


@inline
def body_in(motion, i, p):
    """Return robot i's body, a Rectangle, before the substep."""
    return body_of(motion[X, i], motion[Y, i], motion[COS, i], motion[SIN, i], p)


@inline
def trial_body(motion, i, p):
    """Return robot i's body, a Rectangle, on trial."""
    return body_of(motion[TRY_X, i], motion[TRY_Y, i], motion[TRY_COS, i], motion[TRY_SIN, i], p)


@inline
def _back(motion, i, p):
    """Return how far [m] robot i passes the ends of its arc on trial if its speed changes sign."""
    speed, next_speed = motion[SPEED, i] - motion[ACCELERATION, i] * p["dt"], motion[SPEED, i]
    if speed * next_speed >= ZERO:
        return ZERO
    bend = curvature(motion[STEER, i] - HALF * motion[STEER_RATE, i] * p["dt"], p["wheelbase"])
    return turns_back(speed, next_speed, bend, p)


@part
def _touches_obstacle(motion, i, between, p, floor):
    """Whether robot i on trial touches a shelf at the end or, if asked, on the way."""
    start, end = body_in(motion, i, p), trial_body(motion, i, p)
    if not touches_obstacle(Sweep(start, end, _back(motion, i, p)), motion[WAY, i], between, p, floor):
        return False
    # a robot that was put into a shelf may leave it
    return meets_obstacle(end, floor) or not body_touches_shelf(start, floor)


@inline
def _tries_a_shelf(motion, i, guarded, p, floor):
    """Whether robot i on trial touches a shelf at the end or, unless guarded, on the way."""
    before, way = motion[ROOM, i], motion[WAY, i]
    if before > way:
        motion[ROOM, i] = before - way
        return False
    body = trial_body(motion, i, p)
    room = disc_room(body, floor)
    motion[ROOM, i] = room
    if guarded is not None:
        return room <= ZERO and meets_obstacle(body, floor)
    between = max(before, ZERO) + max(room, ZERO) <= way
    return (between or room <= ZERO) and _touches_obstacle(motion, i, between, p, floor)


@inline
def keep_off_shelves(robots, motion, flags, guarded, p, kinds, floor):
    """Put back the robots that touch a shelf on trial; guarded: the shield has checked the way (worlds.Features)."""
    for i in range(robots.shape[0]):
        own = kind_of(i, p, kinds)
        if flags[MOVING, i] == 0 or motion[ROOM, i] > own["stride"]:  # too far from shelves for this physics step
            continue
        if _tries_a_shelf(motion, i, guarded, own, floor):
            put_back(motion, flags, i)
            r = robots[i]
            events = r["events"]
            events["touching"] = 1
            if events["shelf_contact"] == 0:
                events["hit_shelf"] += 1
            events["shelf_contact"] = 1


@part
def _touch_on_the_way(motion, i, j, way, p, q):
    """Whether robots i and j, with parameters p and q, touch on trial, at the end or before; way: of both [m]."""
    end, other_end = trial_body(motion, i, p), trial_body(motion, j, q)
    gap = separation(end, other_end)
    if gap <= ZERO or gap > way:
        return gap <= ZERO
    start, other_start = body_in(motion, i, p), body_in(motion, j, q)
    before = separation(start, other_start)
    if before <= ZERO or before > way - gap:  # robots that were put into each other may part
        return False
    one, other = Sweep(start, end, _back(motion, i, p)), Sweep(other_start, other_end, _back(motion, j, q))
    return touch_between(one, other, q["offset"], p, q)


@inline
def _try_a_touch(motion, i, j, guarded, p, q):
    """Whether robots i and j, with parameters p and q, touch on trial at the end or, unless guarded, before."""
    one, other = trial_body(motion, i, p), trial_body(motion, j, q)
    way = ZERO if guarded is not None else motion[WAY, i] + motion[WAY, j]
    reach = p["radius"] + q["radius"] + way
    if squared_distance(one, other) > reach * reach or not rectangles_touch(grown(one, way), other):
        return False
    return guarded is not None or _touch_on_the_way(motion, i, j, way, p, q)


@inline
def _runs_into(motion, i, j, p, q):
    """Whether robot i's trial pose touches robot j at its start: then i is at fault."""
    return rectangles_touch(trial_body(motion, i, p), body_in(motion, j, q))


@inline
def keep_off_robots(motion, flags, pairs, count, guarded, p, kinds):
    """Put back the robots that touch on trial, all at once, until none touch.

    Of two robots that touch, the one that moved into the other's place is put back, so that a pusher cannot hold
    another robot. Both are put back if both did, or if they met half-way.
    """
    again = count > 0
    flags[BLOCKED, :] = 0
    while again:
        again = False
        for k in range(count):
            i, j = pairs[k, 0], pairs[k, 1]
            one, other = kind_of(i, p, kinds), kind_of(j, p, kinds)
            if (flags[MOVING, i] == 0 and flags[MOVING, j] == 0) or not _try_a_touch(motion, i, j, guarded, one, other):
                continue
            first, second = _runs_into(motion, i, j, one, other), _runs_into(motion, j, i, other, one)
            if first or not second:
                flags[BLOCKED, i] = flags[MOVING, i]
            if second or not first:
                flags[BLOCKED, j] = flags[MOVING, j]
            pairs[k, 2] = 1
            again = True
        if again:
            for i in range(flags.shape[1]):
                if flags[BLOCKED, i] != 0:
                    put_back(motion, flags, i)


@inline
def accept_motion(robots, motion):
    """Make the trial poses the real ones, and add up the distance driven."""
    for i in range(robots.shape[0]):
        dx, dy = motion[TRY_X, i] - motion[X, i], motion[TRY_Y, i] - motion[Y, i]
        way = np.sqrt(dx * dx + dy * dy)
        r = robots[i]
        r["events"]["driven"] += way
        r["totals"]["distance"] += np.float64(way)
        for k in range(5):
            motion[X + k, i] = motion[TRY_X + k, i]
