"""Motions for the shield: one step as commanded, then a full stop; outlined, sampled, compared.

Outlines show that most motions are far from everything. The others are sampled at every substep by the arithmetic of
contact.py; sweep.py checks between two samples.
"""

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.contact import COS, HEADING, SIN, SPEED, STEER, X, Y
from warehouse_env.simulation.physics.footprint import body_room, body_touches_shelf, touches_obstacle
from warehouse_env.simulation.physics.geometry import (
    Rectangle,
    body_at,
    grown,
    rectangles_touch,
    separation,
    squared_distance,
)
from warehouse_env.simulation.physics.kinematics import (
    arc_driven,
    arc_end,
    braking,
    chassis_of,
    curvature,
    next_motion,
    roll,
    way_driven,
)
from warehouse_env.simulation.physics.sweep import Sweep, touch_between, turns_back
from warehouse_env.simulation.physics.trigonometry import HALF, ZERO, sin_cos

REST = np.float32(1e-6)  # [m/s] below which a robot stands: the rounding error of a speed
_EIGHTH = np.float32(0.125)
_ROOT_2 = np.float32(1.4142137)
SLACK = np.float32(1e-3)  # [m] for rounding where poses are not the samples themselves
# Arrays of shield.scratch. paths float32[N + 1, T + 1, PLACE]: the body's centre and heading now and after each substep
# of the committed motion, and the longest path [m] of any point in that substep. The last row is the motion on trial.
CENTRE_X, CENTRE_Y, BODY_COS, BODY_SIN, WAY = range(5)
PLACE = 5
# outlines float32[OUTLINE, N + 1]: a rectangle around all that a motion sweeps [m], half its diagonal; once sampled,
# the longest path of any point in one substep, and how far the body passes the ends of its arcs [m].
MIDDLE_X, MIDDLE_Y, AXIS_COS, AXIS_SIN, LONG, WIDE, REACH, PACE, TURNS_BACK = range(9)
OUTLINE = 9
# marks int32[MARK, N + 1]: samples of a path, 0 if not sampled yet; the robot has committed in this step
SAMPLES, COMMITTED = 0, 1
MARK = 2


@inline
def stopping_distance(speed, p):
    """Return the distance [m] of a full stop, negative backwards; a bound, since the last step may brake gently."""
    hardest, step = p["max_acceleration"], p["time_step"]
    way = HALF * speed * speed / hardest + _EIGHTH * hardest * step * step
    return ZERO if speed == ZERO else way if speed > ZERO else -way


@inline
def draw_outline(row, pose, way, bend, before, outlines, p):
    """Write the rectangle around a stop of `way` [m] from a pose, and around the motion before it.

    Its axis is the heading half-way. From there the front axle drives at most way / 2 along it and bend way^2 / 8 to
    its side, and the body turns by bend way / 2. pose: x, y, heading, its cosine and sine; before: bounds of the
    distance [m] and turn [rad] driven until then.
    """
    x, y, heading, c, s = pose
    driven, turned = before
    if way != ZERO:
        x, y, heading = arc_end(x, y, heading, HALF * way, bend)
        s, c = sin_cos(heading)
    half_way = HALF * abs(way)
    half_turn = half_way * abs(bend)
    swing = p["far"] * (half_turn + turned)
    long = p["half_length"] + half_way + driven + swing
    wide = p["half_width"] + HALF * half_way * half_turn + driven * (half_turn + turned) + swing
    outlines[MIDDLE_X, row], outlines[MIDDLE_Y, row] = x - p["offset"] * c, y - p["offset"] * s
    outlines[AXIS_COS, row], outlines[AXIS_SIN, row] = c, s
    outlines[LONG, row], outlines[WIDE, row] = long, wide
    outlines[REACH, row] = np.sqrt(long * long + wide * wide)


@part
def sample(row, i, command, motion, paths, outlines, marks, p):
    """Sample robot i's motion into a row of `paths`: a command for some substeps, then full braking.

    command: acceleration, steering rate, and the number of substeps.
    """
    acceleration, steer_rate, commanded = command
    x, y, heading, c, s = motion[X, i], motion[Y, i], motion[HEADING, i], motion[COS, i], motion[SIN, i]
    speed, steer, dt = motion[SPEED, i], motion[STEER, i], p["dt"]
    offset, far, substeps, chassis = p["offset"], p["far"], p["substeps"], chassis_of(p)
    mean, bend = steer, curvature(steer, chassis.wheelbase)
    pace, back, n = ZERO, ZERO, 0
    paths[row, 0, CENTRE_X], paths[row, 0, CENTRE_Y] = x - offset * c, y - offset * s
    paths[row, 0, BODY_COS], paths[row, 0, BODY_SIN] = c, s
    way = ZERO
    while n + substeps < paths.shape[1]:
        if n >= commanded:
            if abs(speed) < REST:
                break
            acceleration, steer_rate = braking(speed, p), ZERO
        for _ in range(substeps):
            next_speed, next_steer = next_motion(speed, steer, acceleration, steer_rate, chassis, dt)
            if HALF * (steer + next_steer) != mean:  # also in the substep after the one that reached the lock
                mean = HALF * (steer + next_steer)
                bend = curvature(mean, chassis.wheelbase)
            way = way_driven(speed, next_speed, bend, far, dt)
            if speed != ZERO or next_speed != ZERO:
                distance = HALF * (speed + next_speed) * dt
                x, y, heading = roll(x, y, heading, distance, bend)
                s, c = sin_cos(heading)
                pace = max(pace, way)
                back = max(back, turns_back(speed, next_speed, bend, p))
            speed, steer = next_speed, next_steer
            n += 1
            paths[row, n, CENTRE_X], paths[row, n, CENTRE_Y] = x - offset * c, y - offset * s
            paths[row, n, BODY_COS], paths[row, n, BODY_SIN], paths[row, n, WAY] = c, s, way
    outlines[PACE, row], outlines[TURNS_BACK, row] = pace + p["blur"], back
    marks[SAMPLES, row] = n + 1


@inline
def outline_of(row, outlines):
    """Return the outline in a row, a Rectangle."""
    return Rectangle(
        outlines[MIDDLE_X, row], outlines[MIDDLE_Y, row], outlines[AXIS_COS, row], outlines[AXIS_SIN, row],
        outlines[LONG, row], outlines[WIDE, row],
    )  # fmt: skip


@inline
def outlines_meet(one, row, other, gap, outlines):
    """Whether the outline `one` of a row comes within `gap` [m] of the outline in row `other`."""
    reach, theirs = outlines[REACH, row] + outlines[REACH, other] + gap, outline_of(other, outlines)
    return squared_distance(one, theirs) <= reach * reach and rectangles_touch(grown(one, gap), theirs)


@inline
def sampled(row, n, paths, p):
    """Return the body, a Rectangle, at a sample of a row's motion."""
    return body_at(
        paths[row, n, CENTRE_X], paths[row, n, CENTRE_Y], paths[row, n, BODY_COS], paths[row, n, BODY_SIN], p
    )


@inline
def _touch_before(a, k, i, b, m, j, motions, pair):
    """Whether the motions in rows a and b touch between samples i and k of a, and j and m of b."""
    (paths, outlines), (p, q) = motions, pair
    one = Sweep(sampled(a, i, paths, p), sampled(a, k, paths, p), outlines[TURNS_BACK, a])
    other = Sweep(sampled(b, j, paths, q), sampled(b, m, paths, q), outlines[TURNS_BACK, b])
    return touch_between(one, other, q["offset"], p, q)


@part
def least_separation(a, b, paths, outlines, marks, p, q):
    """Return the least separation [m] of two motions at equal times; above the margin it is only a bound.

    p, q: parameters of the robots in rows a and b. Skips substeps in which they cannot come within the margin: a
    separation is at least 0.7 of the distance. If they touch between two samples, the result is at most 0.
    """
    most = outlines[PACE, a] + outlines[PACE, b]
    last_a, last_b = marks[SAMPLES, a] - 1, marks[SAMPLES, b] - 1
    last, n, least, before = max(last_a, last_b), 0, np.float32(np.inf), np.float32(np.inf)
    while n <= last:
        k, m = min(n, last_a), min(n, last_b)
        gap = separation(sampled(a, k, paths, p), sampled(b, m, paths, q))
        if n > 0 or last == 0:  # the present poses are no choice of a motion
            least = min(least, gap)
        both = before + gap if min(before, gap) > ZERO else np.float32(np.inf)
        if both <= most:
            i, j = k - 1 if n <= last_a else k, m - 1 if n <= last_b else m  # a body at rest has no sample before
            way = paths[a, k, WAY] if n <= last_a else ZERO
            if n <= last_b:
                way += paths[b, m, WAY]
            if both <= way and _touch_before(a, k, i, b, m, j, (paths, outlines), (p, q)):
                least = min(least, HALF * (both - most))
        n, before = n + 1, gap
        spare = gap - _ROOT_2 * p["field_margin"] - SLACK
        if spare > most:
            passed = last if most == ZERO else int(min(spare / most, np.float32(last)))
            n, before = n + passed, before - np.float32(passed) * most
    return least


@part
def meets_shelf(row, paths, outlines, marks, p, floor):
    """Whether the body touches an obstacle anywhere along a sampled motion."""
    pace = outlines[PACE, row]
    n, count, before = 1, marks[SAMPLES, row], ZERO
    while n < count:
        body = sampled(row, n, paths, p)
        room = body_room(body, floor) - SLACK
        way, near = paths[row, n, WAY], room <= ZERO
        room = max(room, ZERO)
        between = before + room <= way
        if near or between:
            swept = Sweep(sampled(row, n - 1, paths, p), body, outlines[TURNS_BACK, row])
            if touches_obstacle(swept, way, between, p, floor):
                return True
        n, before = n + 1, room
        if room > pace:
            passed = count if pace == ZERO else int(min(room / pace, np.float32(count)))
            n, before = n + passed, before - np.float32(passed) * pace
    return False


@inline
def outline_trial(i, acceleration, steer_rate, motion, outlines, p):
    """Write the outline of robot i's motion at a command into the last row."""
    x, y, heading, c, s = motion[X, i], motion[Y, i], motion[HEADING, i], motion[COS, i], motion[SIN, i]
    speed, steer, dt, chassis = motion[SPEED, i], motion[STEER, i], p["dt"], chassis_of(p)
    driven, turned = ZERO, ZERO
    for _ in range(p["substeps"]):
        next_speed, next_steer = next_motion(speed, steer, acceleration, steer_rate, chassis, dt)
        distance, bend = arc_driven(speed, next_speed, steer, next_steer, chassis, dt)
        x, y, heading = roll(x, y, heading, distance, bend)
        driven += abs(distance)
        turned += abs(distance * bend)
        speed, steer = next_speed, next_steer
    s, c = sin_cos(heading)
    way, bend = stopping_distance(speed, p), curvature(steer, chassis.wheelbase)
    draw_outline(motion.shape[1], (x, y, heading, c, s), way, bend, (driven, turned), outlines, p)


@inline
def is_far_from_shelves(row, outlines, floor):
    """Whether a motion's outline touches no shelf."""
    return not body_touches_shelf(grown(outline_of(row, outlines), SLACK), floor)
