"""What would happen: for every (speed level, lateral offset), how long until the body would touch a predicted robot.

An optional slice of the observation, made of the rest of it alone (route ahead, own motion, neighbours): the own body
is carried along the route, from its present lateral offset to the commanded one, while the speed changes at the
vehicle's acceleration; the others drive straight on. Both are wrong in part: what to make of it is left to the policy.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.observation import NEIGHBOUR
from warehouse_env.simulation.geometry import rectangles_touch
from warehouse_env.simulation.kernel import inline, kernel
from warehouse_env.simulation.trigonometry import HALF, ONE, PI, ZERO, sin_cos

HORIZON = np.float32(2.4)  # [s]
SAMPLES = 8  # times looked at within the horizon
SETTLE = np.float32(1.5)  # [m] of driving in which a lateral offset is reached
MARGIN = np.float32(0.03)  # [m] kept now
MARGIN_RATE = np.float32(0.05)  # [m/s] more of it, the further ahead
TURNING = np.float32(1.2)  # [rad] of bearing from which the robot turns on the spot
TURN_SIDE = np.float32(0.75)  # [m] half the side of the square that a turn on the spot may sweep
_FIVE = np.float32(5.0)
_SHORT = np.float32(1e-3)
_DIAGONAL = np.float32(1.4143)  # of a unit square, rounded up


@inline
def travel(speed, target, acceleration, t):  # type: ignore[no-untyped-def]
    """Return the metres driven in t [s] while the speed changes to `target` at the given rate."""
    rise = abs(target - speed) / acceleration
    if t <= rise:
        sign = ONE if target > speed else -ONE
        return speed * t + HALF * sign * acceleration * t * t
    return HALF * (speed + target) * rise + target * (t - rise)


@inline
def _route_at(row, route, p, lateral, nx, ny, s):  # type: ignore[no-untyped-def]
    """Point of the route `s` [m] ahead in the own frame, and the step (x, y, dx, dy) between its route points.

    (nx, ny): unit vector to the left of the route; its foot point is `lateral` [m] to the right of the robot.
    """
    k = min(int(s / p["route_spacing"]), p["route_points"] - 1)
    ax, ay = -lateral * nx, -lateral * ny
    if k > 0:
        ax, ay = _FIVE * row[route + 2 * k - 2], _FIVE * row[route + 2 * k - 1]
    dx, dy = _FIVE * row[route + 2 * k] - ax, _FIVE * row[route + 2 * k + 1] - ay
    part = min(s / p["route_spacing"] - np.float32(k), ONE)
    if dx * dx + dy * dy < _SHORT * _SHORT:
        part = ZERO
    return ax + part * dx, ay + part * dy, dx, dy


@inline
def _own_pose(x, y, dx, dy, lateral, offset, s):  # type: ignore[no-untyped-def]
    """Front axle and heading (x, y, c, s) after `s` [m] towards a lateral offset; x, y, dx, dy as of _route_at."""
    if s <= ZERO:
        return s, ZERO, ONE, ZERO
    norm = np.sqrt(dx * dx + dy * dy)
    ux, uy = (dx / norm, dy / norm) if norm >= _SHORT else (ONE, ZERO)
    left = max(ZERO, ONE - s / SETTLE)
    side = offset + (lateral - offset) * left
    slope = (offset - lateral) / SETTLE if left > ZERO else ZERO
    norm = np.sqrt(ONE + slope * slope)
    return x - side * uy, y + side * ux, (ux - slope * uy) / norm, (uy + slope * ux) / norm


@inline
def _touches(x, y, c, s, margin, ox, oy, oc, os, p):  # type: ignore[no-untyped-def]
    """Whether the body with its front axle at (x, y), grown by `margin` [m], touches the other, centred at (ox, oy)."""
    half_length, half_width = p["half_length"] + margin, p["half_width"] + margin
    far = p["radius"] + p["radius"] + _DIAGONAL * margin
    dx = ox - (x - p["offset"] * c + p["offset"])  # the frame's origin is the own body's centre now
    dy = oy - (y - p["offset"] * s)
    return dx * dx + dy * dy < far * far and rectangles_touch(
        dx, dy, c, s, half_length, half_width, oc, os, p["half_length"], p["half_width"]
    )


@inline
def _turns_into(ox, oy, oc, os, p):  # type: ignore[no-untyped-def]
    """Whether the square that a turn on the spot may sweep touches the other body."""
    far = p["radius"] + _DIAGONAL * TURN_SIDE
    return ox * ox + oy * oy < far * far and rectangles_touch(
        ox, oy, ONE, ZERO, TURN_SIDE, TURN_SIDE, oc, os, p["half_length"], p["half_width"]
    )


@kernel
def _meet(row, ego, route, start, table, k, ox, oy, oc, os, p):  # type: ignore[no-untyped-def]
    """Enter the conflicts that the commands have with one neighbour at time `k` of SAMPLES, where it is at (ox, oy)."""
    v0 = row[ego] * p["max_speed"]
    bearing, lateral = row[ego + 3] * PI, row[ego + 4]
    sine, cosine = sin_cos(bearing)
    t = HORIZON * np.float32(k) / np.float32(SAMPLES)
    margin = MARGIN + MARGIN_RATE * t
    share = np.float32(k - 1) / np.float32(SAMPLES)
    level = -1  # the row that begins this speed level: braking, backing and turning do not depend on the offset
    for a in range(table.shape[0]):
        speed = table[a, 0]
        if level < 0 or speed != table[level, 0]:
            level = a
            turning = abs(bearing) > TURNING and speed > ZERO
            along = travel(v0, speed, p["max_acceleration"], t)
            x, y, dx, dy = _route_at(row, route, p, lateral, -sine, cosine, max(along, ZERO))
        elif speed <= ZERO or turning:
            row[start + a] = row[start + level]
            continue
        if row[start + a] < ONE:  # an earlier conflict
            continue
        if turning:
            touches = _turns_into(ox, oy, oc, os, p)
        else:
            offset = table[a, 1] if speed > ZERO else ZERO
            own_x, own_y, c, s = _own_pose(x, y, dx, dy, lateral, offset, along)
            touches = _touches(own_x, own_y, c, s, margin, ox, oy, oc, os, p)
        if touches:
            row[start + a] = share


@inline
def write_predictions(row, ego, route, near, table, p, start):  # type: ignore[no-untyped-def]
    """Write the slice `predictions` from row[start] on: of each command the share of HORIZON until the body would
    touch a neighbour, 1 if it would not.

    row: the observation float32[D], written but for this; ego, route, near: where its slices start; table float32[K,
    2]: the commands (speed, offset). Nothing is looked at where no command can bring the bodies together.
    """
    for a in range(table.shape[0]):
        row[start + a] = ONE
    v0, lateral = row[ego] * p["max_speed"], abs(row[ego + 4])
    slowest, fastest, widest = ZERO, ZERO, ZERO
    for a in range(table.shape[0]):
        slowest, fastest = min(slowest, table[a, 0]), max(fastest, table[a, 0])
        widest = max(widest, abs(table[a, 1]))
    for k in range(1, SAMPLES + 1):
        t = HORIZON * np.float32(k) / np.float32(SAMPLES)
        ahead = travel(v0, fastest, p["max_acceleration"], t)
        behind = -travel(v0, slowest, p["max_acceleration"], t)
        # of the centre from where it is: the way, sideways to the route and to the offset, the axle about the centre
        reach = max(max(ahead, behind), ZERO) + lateral + max(lateral, widest) + p["offset"] + p["offset"]
        reach += p["radius"] + p["radius"] + max(_DIAGONAL * (MARGIN + MARGIN_RATE * t), TURN_SIDE)
        for j in range(p["neighbours"]):
            at = near + j * NEIGHBOUR
            if row[at + 6] == ZERO:
                break
            ox = row[at] * p["lidar_range"] + (row[at + 4] * p["max_speed"] + v0) * t
            oy = row[at + 1] * p["lidar_range"] + row[at + 5] * p["max_speed"] * t
            if ox * ox + oy * oy < reach * reach:
                _meet(row, ego, route, start, table, k, ox, oy, row[at + 2], row[at + 3], p)
