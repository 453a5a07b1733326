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
def _route_at(row, start, points, spacing, x0, y0, s):  # type: ignore[no-untyped-def]
    """Point and direction (x, y, ux, uy) of the route `s` [m] ahead, in the own frame; (x0, y0) is its foot point."""
    k = min(int(s / spacing), points - 1)
    ax, ay = x0, y0
    if k > 0:
        ax, ay = _FIVE * row[start + 2 * k - 2], _FIVE * row[start + 2 * k - 1]
    dx, dy = _FIVE * row[start + 2 * k] - ax, _FIVE * row[start + 2 * k + 1] - ay
    norm = np.sqrt(dx * dx + dy * dy)
    if norm < _SHORT:
        return ax, ay, ONE, ZERO
    part = min(s / spacing - np.float32(k), ONE)
    return ax + part * dx, ay + part * dy, dx / norm, dy / norm


@inline
def _own_pose(row, start, points, spacing, lateral, nx, ny, offset, s):  # type: ignore[no-untyped-def]
    """Front axle and heading (x, y, c, s) after `s` [m] towards a lateral offset; backwards along the heading."""
    if s <= ZERO:
        return s, ZERO, ONE, ZERO
    x, y, ux, uy = _route_at(row, start, points, spacing, -lateral * nx, -lateral * ny, s)
    left = max(ZERO, ONE - s / SETTLE)
    side = offset + (lateral - offset) * left
    slope = (offset - lateral) / SETTLE if left > ZERO else ZERO
    norm = np.sqrt(ONE + slope * slope)
    return x - side * uy, y + side * ux, (ux - slope * uy) / norm, (uy + slope * ux) / norm


@kernel
def seconds_free(row, ego, route, near, speed, offset, p):  # type: ignore[no-untyped-def]
    """Return the share of HORIZON until the body would touch a neighbour, 1 if it would not, of one command.

    row: the observation float32[D], written but for this; ego, route, near: where its slices start.
    """
    v0 = row[ego] * p["max_speed"]
    bearing, lateral = row[ego + 3] * PI, row[ego + 4]
    sine, cosine = sin_cos(bearing)
    turning = abs(bearing) > TURNING and speed > ZERO
    for k in range(1, SAMPLES + 1):
        t = HORIZON * np.float32(k) / np.float32(SAMPLES)
        margin = MARGIN + MARGIN_RATE * t
        half_length, half_width = p["half_length"] + margin, p["half_width"] + margin
        far = p["radius"] + p["radius"] + _DIAGONAL * margin
        if turning:
            far = p["radius"] + _DIAGONAL * TURN_SIDE
            x, y, c, s = ZERO, ZERO, ONE, ZERO
            half_length, half_width = TURN_SIDE, TURN_SIDE
        else:
            along = travel(v0, speed, p["max_acceleration"], t)
            x, y, c, s = _own_pose(
                row, route, p["route_points"], p["route_spacing"], lateral, -sine, cosine, offset, along
            )
        cx, cy = x - p["offset"] * c + p["offset"], y - p["offset"] * s  # from the own body's centre now
        for j in range(p["neighbours"]):
            at = near + j * NEIGHBOUR
            if row[at + 6] == ZERO:
                break
            dx = row[at] * p["lidar_range"] + (row[at + 4] * p["max_speed"] + v0) * t - cx
            dy = row[at + 1] * p["lidar_range"] + row[at + 5] * p["max_speed"] * t - cy
            if dx * dx + dy * dy < far * far and rectangles_touch(
                dx, dy, c, s, half_length, half_width,
                row[at + 2], row[at + 3], p["half_length"], p["half_width"],
            ):  # fmt: skip
                return np.float32(k - 1) / np.float32(SAMPLES)
    return ONE


@inline
def write_predictions(row, ego, route, near, table, p, start):  # type: ignore[no-untyped-def]
    """Write the slice `predictions` from row[start] on; table float32[K, 2]: the speeds and offsets in question.

    Braking to a stop and backing do not depend on the offset, so they are looked at once.
    """
    alone = row[near + 6] == ZERO
    for a in range(table.shape[0]):
        speed = table[a, 0]
        if alone:
            row[start + a] = ONE
        elif a > 0 and speed <= ZERO and speed == table[a - 1, 0]:
            row[start + a] = row[start + a - 1]
        else:
            offset = table[a, 1] if speed > ZERO else ZERO
            row[start + a] = seconds_free(row, ego, route, near, speed, offset, p)
