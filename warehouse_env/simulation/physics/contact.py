"""Who touches whom: trial motion, exact contact, put-back, and the episodes that are counted.

All robots move at once; whoever runs into something, at the substep's end or on the way there (sweep.py), is put back
to its start with zero speed, and this is repeated until nothing overlaps: at worst all stand where they stood. So no
body ever overlaps another. Under the protective field, which has looked at the way, the ends are looked at alone.
A contact episode begins with a touch and ends when the gap is wider than `near_miss_gap`: a robot that keeps
pushing another is counted once, however often it is put back. A near miss is a gap under `near_miss_gap` that
opened again untouched.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, kernel
from warehouse_env.simulation.physics.buckets import CENTRE_X, CENTRE_Y, bucket_at
from warehouse_env.simulation.physics.footprint import body_room, body_touches_shelf, clearance_at
from warehouse_env.simulation.physics.geometry import rectangle_gap, rectangles_touch, separation
from warehouse_env.simulation.physics.kinematics import curvature, drive
from warehouse_env.simulation.physics.sweep import sweeps_shelf, touch_between, turn_bound, turns_back, way_bound
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, sin_cos
from warehouse_env.simulation.state import GAP_HORIZON

_HORIZON = np.float32(GAP_HORIZON)
NEAR, CONTACT = 1, 2  # status of a pair: near and untouched, in a contact episode; 0 = apart

# Rows of `motion` float32[MOTION, N], the robots' motion within one physics step, field by field side by side: the
# present pose, what changes it, the pose that is tried, and the room [m] that a robot has to the nearest shelf.
X, Y, HEADING, COS, SIN, SPEED, STEER, ACCELERATION, STEER_RATE = range(9)
TRY_X, TRY_Y, TRY_HEADING, TRY_COS, TRY_SIN, ROOM = range(9, 15)
MOTION = 15
# `lanes` float32[MOTION x LANES] holds LANES robots of `motion` at constant distances, so that the compiler sees that
# the rows do not overlap; whether a robot moves stands in place of its room.
LANES, MOVES = 8, ROOM
# Rows of `flags` int32[FLAGS, N]: does the tried pose differ from the present one, is it to be put back?
MOVING, BLOCKED = 0, 1
FLAGS = 2


@kernel
def scratch(count, p):
    """Return a world's arrays: pairs int32[P, 3], motion float32[MOTION, N], flags int32[FLAGS, N] and lanes."""
    pairs, lanes = np.empty((p["most_pairs"], 3), np.int32), np.zeros(MOTION * LANES, np.float32)
    return pairs, np.empty((MOTION, count), np.float32), np.empty((FLAGS, count), np.int32), lanes


@inline
def list_pairs(bodies, order, starts, p, pairs):
    """Write the pairs (i, j, touched = 0), j < i, that could come near within a physics step; return their number.

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
def load(robots, i, acceleration, steer_rate, p, clearance, motion):
    """Take robot i's state at the start of a physics step, and its command [m/s^2], [rad/s], into `motion`."""
    r = robots[i]
    c, s = r["cos"], r["sin"]
    motion[X, i], motion[Y, i], motion[HEADING, i] = r["x"], r["y"], r["heading"]
    motion[COS, i], motion[SIN, i] = c, s
    motion[SPEED, i], motion[STEER, i] = r["speed"], r["steer"]
    motion[ACCELERATION, i], motion[STEER_RATE, i] = acceleration, steer_rate
    centre_x, centre_y = r["x"] - p["offset"] * c, r["y"] - p["offset"] * s
    motion[ROOM, i] = clearance_at(centre_x, centre_y, clearance, p["cell"]) - p["radius"]


@inline
def store(robots, motion):
    """Write the motion of a physics step back into the robots."""
    for i in range(robots.shape[0]):
        r = robots[i]
        r["x"], r["y"], r["heading"] = motion[X, i], motion[Y, i], motion[HEADING, i]
        r["cos"], r["sin"] = motion[COS, i], motion[SIN, i]
        r["speed"], r["steer"] = motion[SPEED, i], motion[STEER, i]


@inline
def _drive_lanes(lanes, p):
    """Move the robots in `lanes` for a substep, on trial; without branches and calls, so in vector instructions."""
    dt, wheelbase = p["dt"], p["wheelbase"]
    slowest, fastest, lock = p["min_speed"], p["max_speed"], p["max_steer"]
    for k in range(LANES):
        speed, steer = lanes[SPEED * LANES + k], lanes[STEER * LANES + k]
        next_speed = min(max(speed + lanes[ACCELERATION * LANES + k] * dt, slowest), fastest)
        next_steer = min(max(steer + lanes[STEER_RATE * LANES + k] * dt, -lock), lock)
        x, y, heading = lanes[X * LANES + k], lanes[Y * LANES + k], lanes[HEADING * LANES + k]
        c, s = lanes[COS * LANES + k], lanes[SIN * LANES + k]
        to_x, to_y, to_heading = drive(x, y, heading, speed, next_speed, steer, next_steer, wheelbase, dt)
        to_s, to_c = sin_cos(to_heading)
        stands = (speed == ZERO) & (next_speed == ZERO)
        lanes[SPEED * LANES + k] = next_speed
        lanes[STEER * LANES + k] = next_steer
        lanes[TRY_X * LANES + k] = x if stands else to_x
        lanes[TRY_Y * LANES + k] = y if stands else to_y
        lanes[TRY_HEADING * LANES + k] = heading if stands else to_heading
        lanes[TRY_COS * LANES + k] = c if stands else to_c
        lanes[TRY_SIN * LANES + k] = s if stands else to_s
        lanes[MOVES * LANES + k] = ZERO if stands else ONE


@inline
def try_motion(motion, flags, lanes, p):
    """Move all robots for a substep, on trial: the TRY_ rows; speed and steering change for good."""
    for begin in range(0, motion.shape[1], LANES):
        count = min(LANES, motion.shape[1] - begin)
        for row in range(TRY_X):
            for k in range(count):
                lanes[row * LANES + k] = motion[row, begin + k]
        _drive_lanes(lanes, p)
        for k in range(count):
            for row in range(SPEED, STEER + 1):
                motion[row, begin + k] = lanes[row * LANES + k]
            for row in range(TRY_X, TRY_SIN + 1):
                motion[row, begin + k] = lanes[row * LANES + k]
            flags[MOVING, begin + k] = lanes[MOVES * LANES + k] != ZERO


@inline
def put_back(motion, flags, i):
    """Make the present pose the one that robot i tries, and stop it."""
    motion[TRY_X, i], motion[TRY_Y, i], motion[TRY_HEADING, i] = motion[X, i], motion[Y, i], motion[HEADING, i]
    motion[TRY_COS, i], motion[TRY_SIN, i] = motion[COS, i], motion[SIN, i]
    motion[SPEED, i] = ZERO
    flags[MOVING, i] = 0
    flags[BLOCKED, i] = 0


@inline
def _way(motion, i, p):
    """Return at least how far [m] any point of robot i's body moves on trial."""
    turn = turn_bound(motion[COS, i], motion[SIN, i], motion[TRY_COS, i], motion[TRY_SIN, i])
    return way_bound(motion[TRY_X, i] - motion[X, i], motion[TRY_Y, i] - motion[Y, i], turn, p)


@inline
def _back(motion, i, p):
    """Return how far robot i may leave its arc [m] on trial, where it turns back."""
    bend = curvature(motion[STEER, i] - HALF * motion[STEER_RATE, i] * p["dt"], p["wheelbase"])
    return turns_back(motion[SPEED, i] - motion[ACCELERATION, i] * p["dt"], motion[SPEED, i], bend, p)


@inline
def _tries_a_shelf(motion, i, guarded, p, solid, clearance):
    """Whether robot i on trial touches a shelf, where it comes to or, unless guarded, on the way."""
    half_length, half_width, cell = p["half_length"], p["half_width"], p["cell"]
    c1, s1 = motion[TRY_COS, i], motion[TRY_SIN, i]
    x1, y1 = motion[TRY_X, i] - p["offset"] * c1, motion[TRY_Y, i] - p["offset"] * s1
    if guarded is not None:
        return body_touches_shelf(x1, y1, c1, s1, half_length, half_width, solid, clearance, cell)
    way, room = _way(motion, i, p), body_room(x1, y1, c1, s1, half_length, half_width, clearance, cell)
    if room > way:
        return False
    if room <= ZERO and body_touches_shelf(x1, y1, c1, s1, half_length, half_width, solid, clearance, cell):
        return True
    c0, s0 = motion[COS, i], motion[SIN, i]
    x0, y0 = motion[X, i] - p["offset"] * c0, motion[Y, i] - p["offset"] * s0
    before = body_room(x0, y0, c0, s0, half_length, half_width, clearance, cell)
    if max(room, ZERO) + max(before, ZERO) > way:
        return False
    return sweeps_shelf(x0, y0, c0, s0, x1, y1, c1, s1, _back(motion, i, p), p, solid) and (
        before > ZERO or not body_touches_shelf(x0, y0, c0, s0, half_length, half_width, solid, clearance, cell)
    )  # who was put into a shelf may leave it


@inline
def keep_off_shelves(robots, motion, flags, guarded, p, solid, clearance):
    """Put back the robots that touch a shelf on trial; guarded: see step.Features, whose field has looked between."""
    for i in range(robots.shape[0]):
        if flags[MOVING, i] == 0 or motion[ROOM, i] > p["stride"]:  # too far off for this physics step
            continue
        if _tries_a_shelf(motion, i, guarded, p, solid, clearance):
            put_back(motion, flags, i)
            r = robots[i]
            r["touching"] = 1
            if r["shelf_contact"] == 0:
                r["hit_shelf"] += 1
            r["shelf_contact"] = 1


@inline
def _try_a_touch(motion, i, j, guarded, p):
    """Whether robots i and j touch on trial, where they come to or, unless guarded, on the way."""
    offset, half_length, half_width = p["offset"], p["half_length"], p["half_width"]
    c1, s1, other_c1, other_s1 = motion[TRY_COS, i], motion[TRY_SIN, i], motion[TRY_COS, j], motion[TRY_SIN, j]
    x1, y1 = motion[TRY_X, i] - offset * c1, motion[TRY_Y, i] - offset * s1
    other_x1, other_y1 = motion[TRY_X, j] - offset * other_c1, motion[TRY_Y, j] - offset * other_s1
    dx, dy = other_x1 - x1, other_y1 - y1
    reach = p["radius"] + p["radius"]
    if guarded is not None:
        return dx * dx + dy * dy <= reach * reach and rectangles_touch(
            dx, dy, c1, s1, half_length, half_width, other_c1, other_s1, half_length, half_width
        )
    reach += p["stride"] + p["stride"]
    if dx * dx + dy * dy > reach * reach:
        return False
    gap = separation(dx, dy, c1, s1, other_c1, other_s1, half_length, half_width)
    if gap <= ZERO:
        return True
    way = _way(motion, i, p) + _way(motion, j, p)
    if gap > way:
        return False
    c0, s0, other_c0, other_s0 = motion[COS, i], motion[SIN, i], motion[COS, j], motion[SIN, j]
    x0, y0 = motion[X, i] - offset * c0, motion[Y, i] - offset * s0
    other_x0, other_y0 = motion[X, j] - offset * other_c0, motion[Y, j] - offset * other_s0
    before = separation(other_x0 - x0, other_y0 - y0, c0, s0, other_c0, other_s0, half_length, half_width)
    return ZERO < before <= way - gap and touch_between(
        x0, y0, c0, s0, x1, y1, c1, s1,
        other_x0, other_y0, other_c0, other_s0, other_x1, other_y1, other_c1, other_s1,
        half_length, half_width, offset, _back(motion, i, p), _back(motion, j, p), p,
    )  # fmt: skip


@inline
def _runs_into(motion, i, j, p):
    """Whether robot i's trial pose touches robot j where that stood: then i is at fault, whatever j does."""
    offset, half_length, half_width = p["offset"], p["half_length"], p["half_width"]
    c, s, other_c, other_s = motion[TRY_COS, i], motion[TRY_SIN, i], motion[COS, j], motion[SIN, j]
    dx = (motion[X, j] - offset * other_c) - (motion[TRY_X, i] - offset * c)
    dy = (motion[Y, j] - offset * other_s) - (motion[TRY_Y, i] - offset * s)
    return rectangles_touch(dx, dy, c, s, half_length, half_width, other_c, other_s, half_length, half_width)


@inline
def keep_off_robots(motion, flags, pairs, count, guarded, p):
    """Put back the robots that touch on trial, at once, again and again until none do.

    Of two that touch, the one that comes to where the other stood is put back, so that nobody is held by a robot
    that pushes it; both are if both did, or if they met half-way.
    """
    again = count > 0
    flags[BLOCKED, :] = 0
    while again:
        again = False
        for k in range(count):
            i, j = pairs[k, 0], pairs[k, 1]
            if (flags[MOVING, i] == 0 and flags[MOVING, j] == 0) or not _try_a_touch(motion, i, j, guarded, p):
                continue
            first, second = _runs_into(motion, i, j, p), _runs_into(motion, j, i, p)
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
        r["driven"] += way
        r["distance"] += np.float64(way)
        for k in range(5):
            motion[X + k, i] = motion[TRY_X + k, i]


@inline
def _known(stamps, j, clock):
    """Return (the place for what is known of robot j, its status when last looked at: 0 if it was not near).

    The first place that is free is taken, so that behind one that was never taken there are none.
    """
    free = -1
    for slot in range(stamps.shape[0]):
        age = clock - (stamps[slot, 1] >> 2)
        if age == 1 and stamps[slot, 0] == j:
            return slot, stamps[slot, 1] & 3
        never = stamps[slot, 1] == 0
        if (age > 1 or never) and free < 0:
            free = slot
        if never:
            break
    return max(free, 0), 0


@inline
def judge_pairs(robots, motion, pairs, count, stamps, clock, p):
    """Measure the gaps, and begin and end contact episodes and near misses.

    stamps int32[N, K, 2]: the pairs in which a robot comes first, listed with the lower number of robots (see
    state.most_near): the other's, and 4 x clock + status when they were last near, so that nothing must be cleared.
    """
    offset, half_length, half_width = p["offset"], p["half_length"], p["half_width"]
    reach = p["radius"] + p["radius"] + _HORIZON
    for k in range(count):
        i, j = pairs[k, 0], pairs[k, 1]
        c, s, other_c, other_s = motion[COS, i], motion[SIN, i], motion[COS, j], motion[SIN, j]
        dx = (motion[X, j] - offset * other_c) - (motion[X, i] - offset * c)
        dy = (motion[Y, j] - offset * other_s) - (motion[Y, i] - offset * s)
        if dx * dx + dy * dy > reach * reach:
            continue
        gap = rectangle_gap(dx, dy, c, s, half_length, half_width, other_c, other_s, half_length, half_width)
        r, o = robots[i], robots[j]
        if pairs[k, 2] != 0:
            gap = ZERO
        r["gap"] = min(r["gap"], gap)
        o["gap"] = min(o["gap"], gap)
        slot, before = _known(stamps[i], j, clock)
        now = before
        if pairs[k, 2] != 0:
            r["touching"] = 1
            o["touching"] = 1
            now = CONTACT
            if before != CONTACT:
                r["hit_robot"] += 1
                o["hit_robot"] += 1
        elif gap >= p["near_miss_gap"]:
            now = 0
            if before == NEAR:
                r["near_miss"] += 1
                o["near_miss"] += 1
        elif before == 0:
            now = NEAR
        if now != 0:
            stamps[i, slot, 0], stamps[i, slot, 1] = j, 4 * clock + now


@inline
def end_shelf_contacts(robots, p, solid, clearance):
    """A shelf episode ends when the body, widened by near_miss_gap, is free again."""
    wide = p["near_miss_gap"]
    for i in range(robots.shape[0]):
        r = robots[i]
        if r["shelf_contact"] != 0:
            c, s = r["cos"], r["sin"]
            cx, cy = r["x"] - p["offset"] * c, r["y"] - p["offset"] * s
            if not body_touches_shelf(
                cx, cy, c, s, p["half_length"] + wide, p["half_width"] + wide, solid, clearance, p["cell"]
            ):
                r["shelf_contact"] = 0
