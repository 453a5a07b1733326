"""PIBT over motion primitives of car-like bodies: one decision of all robots of a world.

A primitive is a speed and a steering angle that the robot goes for during one decision; a stop at that steering
follows. A robot may take it if the body, driven so, meets no shelf and no other's committed motion; what it can always
fall back on is to stop, which the decision before kept free.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import kernel

X, Y, COS, SIN = 0, 1, 2, 3  # of the body's centre
DT = 0.05  # [s] between the poses of a motion: the simulator's substep, at whose ends it looks for contacts
HOLD = 4  # DT for which a command stands
POSES = 52  # of a motion: a decision of a second, and braking from 1.5 m/s
MARGIN = 0.02  # [m] between bodies, and to shelves,
LEAST = 0.002  # [m] but this for who stands nearer, as at a start beside the rim
NEAR = 5.0  # [m] beyond which no two motions meet
UNDECIDED, CHOOSING, CHOSEN = 0, 1, 2  # of a robot


@kernel
def drive(pose, speed, steer, goal_speed, goal_steer, decision, limits, motion):
    """Write the motion float64[POSES, 4]: a decision of so many steps of DT, or of none at all, then the stop.

    Just as simulation/physics/kinematics.py drives it; a stop's last command is weaker, so that it ends at rest.
    (Predicted to 6 mm and looked at every 0.1 s, motions that were to stay LEAST apart touched.)
    pose: x, y, heading of the front axle; limits: acceleration, steering rate, wheelbase, axle to centre.
    """
    x, y, heading = pose[0], pose[1], pose[2]
    most_v, most_s = limits[0] * DT * decision, limits[1] * DT * decision
    change = min(max(goal_speed - speed, -most_v), most_v) / max(decision, 1)
    turn = min(max(goal_steer - steer, -most_s), most_s) / max(decision, 1)
    for k in range(POSES):
        if k >= decision and (k - decision) % HOLD == 0:
            change, turn = -min(max(speed / HOLD, -limits[0] * DT), limits[0] * DT), 0.0
        distance = (speed + 0.5 * change) * DT
        half = -0.5 * distance * np.tan(steer + 0.5 * turn) / limits[2]
        chord = distance * (1.0 - half * half / 6.0)
        x += chord * np.cos(heading + half)
        y += chord * np.sin(heading + half)
        heading += 2.0 * half
        speed += change
        steer += turn
        c, s = np.cos(heading), np.sin(heading)
        motion[k, X], motion[k, Y] = x - limits[3] * c, y - limits[3] * s
        motion[k, COS], motion[k, SIN] = c, s


@kernel
def _apart(dx, dy, c, s, half_length, half_width, other_c, other_s, other_length, other_width):
    """Whether two rectangles are apart along an axis of the first, (c, s), or at right angles to it."""
    along, across = abs(other_c * c + other_s * s), abs(other_s * c - other_c * s)
    if abs(dx * c + dy * s) >= half_length + other_length * along + other_width * across:
        return True
    return abs(dy * c - dx * s) >= half_width + other_length * across + other_width * along


@kernel
def meet(one, two, half_length, half_width, margin):
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
def meets_shelf(motion, solid, cell, half_length, half_width, margin):
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
def _too_near(motion, stop, other, other_stop, body):
    """Whether two motions come nearer than MARGIN, or than LEAST if the robots' stops do."""
    if not meet(motion, other, body[0], body[1], MARGIN):
        return False
    return not meet(stop, other_stop, body[0], body[1], MARGIN) or meet(motion, other, body[0], body[1], LEAST)


@kernel
def _is_free(i, motion, poses, state, motions, stops, body):
    """Whether a motion of robot i keeps clear of those who are choosing or have chosen."""
    for j in range(poses.shape[0]):
        if j == i or state[j] == UNDECIDED or np.hypot(poses[i, 0] - poses[j, 0], poses[i, 1] - poses[j, 1]) > NEAR:
            continue
        if _too_near(motion, stops[i], motions[j], stops[j], body):
            return False
    return True


@kernel
def _fall_back(i, state, choice, motions, stops, body):
    """Let robot i stop, and those as well that have chosen a motion which counts on its moving away."""
    state[i] = CHOSEN
    choice[i] = -1
    motions[i] = stops[i]
    for j in range(state.size):
        if state[j] == CHOSEN and choice[j] >= 0 and _too_near(stops[i], stops[i], motions[j], stops[j], body):
            _fall_back(j, state, choice, motions, stops, body)


@kernel
def decide(
    i, poses, speeds, steers, commands, keys, state, choice, motions, stops, solid, cell, body, limits, decision
):
    """Choose robot i's primitive, the best that meets nobody who has decided; who bars it is asked to decide first.

    state int8[N]: UNDECIDED, CHOOSING or CHOSEN; motions float64[N, POSES, 4]: of the undecided the stop; stops: of
    all. False: it falls back on its stop.
    """
    margin = LEAST if meets_shelf(stops[i], solid, cell, body[0], body[1], MARGIN) else MARGIN
    state[i] = CHOOSING
    motion = np.empty((POSES, 4))
    for k in np.argsort(keys[i]):
        drive(poses[i], speeds[i], steers[i], commands[k, 0], commands[k, 1], decision, limits, motion)
        if meets_shelf(motion, solid, cell, body[0], body[1], margin):
            continue
        if not _is_free(i, motion, poses, state, motions, stops, body):
            continue
        motions[i] = motion
        choice[i] = k
        free = True
        for j in range(poses.shape[0]):
            if state[j] != UNDECIDED or np.hypot(poses[i, 0] - poses[j, 0], poses[i, 1] - poses[j, 1]) > NEAR:
                continue
            if _too_near(motion, stops[i], motions[j], stops[j], body) and not decide(
                j, poses, speeds, steers, commands, keys, state, choice, motions, stops, solid, cell, body, limits,
                decision,
            ):  # fmt: skip
                free = False
                break
        if free and _is_free(i, motion, poses, state, motions, stops, body):  # some may have fallen back meanwhile
            state[i] = CHOSEN
            return True
    _fall_back(i, state, choice, motions, stops, body)
    return False


@kernel
def decide_all(poses, speeds, steers, commands, keys, order, solid, cell, body, limits, decision):
    """Return each robot's primitive int64[N], -1: stop.

    poses float64[N, 3], speeds, steers float64[N]; commands float64[K, 2]: speed and steering of each primitive; keys
    float64[N, K], less is better; order int64[N]: first the highest priority; body: half length, half width.
    """
    n = speeds.size
    motions, choice, state = np.empty((n, POSES, 4)), np.full(n, -1, np.int64), np.full(n, UNDECIDED, np.int8)
    for i in range(n):
        drive(poses[i], speeds[i], steers[i], 0.0, steers[i], 0, limits, motions[i])
    stops = motions.copy()
    for i in order:
        if state[i] == UNDECIDED:
            decide(
                i, poses, speeds, steers, commands, keys, state, choice, motions, stops, solid, cell, body, limits,
                decision,
            )  # fmt: skip
    return choice
