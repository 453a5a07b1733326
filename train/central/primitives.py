"""PIBT over motion primitives of car-like bodies: one decision of all robots of a world.

A primitive is a speed and a steering angle that the robot goes for during one decision; a stop at that steering
follows. A robot may take it if the body, driven so, meets no shelf and no other's committed motion; what it can always
fall back on is to stop, which the decision before kept free.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import kernel

X, Y, COS, SIN = 0, 1, 2, 3  # of the body's centre
DT = 0.1  # [s] between the poses of a motion
POSES = 26  # of a motion: a decision of a second, and braking from 1.5 m/s
MARGIN = 0.02  # [m] between bodies, and to shelves,
LEAST = 0.002  # [m] but this for who has come nearer, since motions are only nearly driven as predicted
NEAR = 5.0  # [m] beyond which no two motions meet


@kernel
def drive(pose, speed, steer, goal_speed, goal_steer, decision, limits, motion):  # type: ignore[no-untyped-def]
    """Write the motion float64[POSES, 4]: a decision of so many steps of DT, or of none at all, then the stop.

    pose: x, y, heading of the front axle; limits: acceleration, steering rate, wheelbase, axle to centre.
    """
    x, y, heading = pose[0], pose[1], pose[2]
    most_v, most_s = limits[0] * DT * decision, limits[1] * DT * decision
    change = min(max(goal_speed - speed, -most_v), most_v) / max(decision, 1)
    turn = min(max(goal_steer - steer, -most_s), most_s) / max(decision, 1)
    for k in range(POSES):
        if k < decision:
            next_speed, next_steer = speed + change, steer + turn
        else:
            next_speed, next_steer = np.sign(speed) * max(abs(speed) - limits[0] * DT, 0.0), steer
        distance = 0.5 * (speed + next_speed) * DT
        angle = -distance * np.tan(0.5 * (steer + next_steer)) / limits[2]
        x += distance * np.cos(heading + 0.5 * angle)
        y += distance * np.sin(heading + 0.5 * angle)
        heading += angle
        speed, steer = next_speed, next_steer
        c, s = np.cos(heading), np.sin(heading)
        motion[k, X], motion[k, Y] = x - limits[3] * c, y - limits[3] * s
        motion[k, COS], motion[k, SIN] = c, s


@kernel
def _apart(dx, dy, c, s, half_length, half_width, other_c, other_s, other_length, other_width):  # type: ignore[no-untyped-def]
    """Whether two rectangles are apart along an axis of the first, (c, s), or at right angles to it."""
    along, across = abs(other_c * c + other_s * s), abs(other_s * c - other_c * s)
    if abs(dx * c + dy * s) >= half_length + other_length * along + other_width * across:
        return True
    return abs(dy * c - dx * s) >= half_width + other_length * across + other_width * along


@kernel
def meet(one, two, half_length, half_width, margin):  # type: ignore[no-untyped-def]
    """Whether two motions float64[POSES, 4] come nearer than `margin` [m] at any time, by separating axes."""
    for k in range(POSES):
        dx, dy = two[k, X] - one[k, X], two[k, Y] - one[k, Y]
        reach = 2.0 * np.hypot(half_length, half_width) + margin
        if dx * dx + dy * dy > reach * reach:
            continue
        wide, long = half_width + 0.5 * margin, half_length + 0.5 * margin
        c, s, d, t = one[k, COS], one[k, SIN], two[k, COS], two[k, SIN]
        if not (
            _apart(dx, dy, c, s, long, wide, d, t, long, wide) or _apart(dx, dy, d, t, long, wide, c, s, long, wide)
        ):
            return True
    return False


@kernel
def meets_shelf(motion, solid, cell, half_length, half_width, margin):  # type: ignore[no-untyped-def]
    """Whether a motion comes nearer than `margin` [m] to a shelf; solid uint8[H + 2, W + 2], see maps/clearance.py."""
    for k in range(POSES):
        x, y, c, s = motion[k, X], motion[k, Y], motion[k, COS], motion[k, SIN]
        row, column = int(np.floor(y / cell)) + 1, int(np.floor(x / cell)) + 1
        for i in range(max(row - 1, 0), min(row + 2, solid.shape[0])):
            for j in range(max(column - 1, 0), min(column + 2, solid.shape[1])):
                if solid[i, j]:
                    dx, dy = (j - 0.5) * cell - x, (i - 0.5) * cell - y
                    half, wide, long = 0.5 * cell, half_width + margin, half_length + margin
                    apart = _apart(dx, dy, c, s, long, wide, 1.0, 0.0, half, half)
                    if not (apart or _apart(dx, dy, 1.0, 0.0, half, half, c, s, long, wide)):
                        return True
    return False


@kernel
def _too_near(motion, stop, other, other_stop, body):  # type: ignore[no-untyped-def]
    """Whether two motions come nearer than MARGIN, or than LEAST if the robots' stops do."""
    if not meet(motion, other, body[0], body[1], MARGIN):
        return False
    return not meet(stop, other_stop, body[0], body[1], MARGIN) or meet(motion, other, body[0], body[1], LEAST)


@kernel
def decide(  # type: ignore[no-untyped-def]
    i, poses, speeds, steers, commands, keys, decided, choice, motions, stops, solid, cell, body, limits, decision
):
    """Choose robot i's primitive, the best that meets nobody who has decided; who bars it is asked to decide first.

    motions float64[N, POSES, 4]: committed by the decided, the stop of the others; stops: of all. False: it falls back
    on its stop.
    """
    n = poses.shape[0]
    margin = LEAST if meets_shelf(stops[i], solid, cell, body[0], body[1], MARGIN) else MARGIN
    decided[i] = True
    motion = np.empty((POSES, 4))
    for k in np.argsort(keys[i]):
        drive(poses[i], speeds[i], steers[i], commands[k, 0], commands[k, 1], decision, limits, motion)
        if meets_shelf(motion, solid, cell, body[0], body[1], margin):
            continue
        free = True
        for j in range(n):
            if decided[j] and j != i and np.hypot(poses[i, 0] - poses[j, 0], poses[i, 1] - poses[j, 1]) < NEAR:
                free &= not _too_near(motion, stops[i], motions[j], stops[j], body)
        if not free:
            continue
        motions[i] = motion
        choice[i] = k
        for j in range(n):
            if j == i or np.hypot(poses[i, 0] - poses[j, 0], poses[i, 1] - poses[j, 1]) > NEAR:
                continue
            if _too_near(motion, stops[i], motions[j], stops[j], body):
                if decided[j]:  # meanwhile, in its fall-back
                    free = False
                else:
                    free = decide(
                        j, poses, speeds, steers, commands, keys, decided, choice, motions, stops, solid, cell, body,
                        limits, decision,
                    )  # fmt: skip
                if not free:
                    break
        if free:
            return True
    motions[i] = stops[i]
    choice[i] = -1
    return False


@kernel
def decide_all(poses, speeds, steers, commands, keys, order, solid, cell, body, limits, decision):  # type: ignore[no-untyped-def]
    """Return each robot's primitive int64[N], -1: stop.

    poses float64[N, 3], speeds, steers float64[N]; commands float64[K, 2]: speed and steering of each primitive; keys
    float64[N, K], less is better; order int64[N]: first the highest priority; body: half length, half width.
    """
    n = speeds.size
    motions, choice, decided = np.empty((n, POSES, 4)), np.full(n, -1, np.int64), np.zeros(n, np.bool_)
    for i in range(n):
        drive(poses[i], speeds[i], steers[i], 0.0, steers[i], 0, limits, motions[i])
    stops = motions.copy()
    for i in order:
        if not decided[i]:
            decide(
                i, poses, speeds, steers, commands, keys, decided, choice, motions, stops, solid, cell, body, limits,
                decision,
            )  # fmt: skip
    return choice
