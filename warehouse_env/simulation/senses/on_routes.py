"""Robots that drive along their routes, side by side: in each lane a robot, or one of the commands that it may get.

A step of the path follower waits for the one before, and each of its operations for the last. Several lanes at a time
fill the pauses, and go through the same vector instructions. Predictions look ahead with it.
"""

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.driver.line import along_after, look_ahead, point_at, pursue
from warehouse_env.simulation.driver.tracking import on_bend
from warehouse_env.simulation.physics.kinematics import approach, curvature
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, sin_cos

APART = np.float32(0.2)  # [s] of a step
# `lanes` float32[ROWS x LANES] has constant strides, so that the compiler sees that no write reaches another row
LANES = 16
X, Y, COS, SIN, SPEED, STEER, ALONG, TARGET_X, TARGET_Y, LIMIT, SIDE, WAY, ROWS = range(13)
_SIXTH, _OVER_24, _OVER_120, _OVER_720 = (np.float32(1.0 / n) for n in (6, 24, 120, 720))
_SHORT = np.float32(0.7)  # [rad] up to which the series holds


@inline
def turned(c, s, turn):
    """Return the heading (cos, sin) half a turn [rad] and a turn on from the heading (c, s)."""
    half = HALF * turn
    q = half * half
    half_s, half_c = half * (ONE - q * (_SIXTH - q * _OVER_120)), ONE - q * (HALF - q * (_OVER_24 - q * _OVER_720))
    if abs(half) > _SHORT:
        half_s, half_c = sin_cos(half)
    mid_c, mid_s = c * half_c - s * half_s, s * half_c + c * half_s
    return mid_c, mid_s, mid_c * half_c - mid_s * half_s, mid_s * half_c + mid_c * half_s


@inline
def driven(v, target, acceleration):
    """Return ([m] driven in APART, the speed [m/s] then) of a robot that changes its speed from `v` to `target`."""
    reached = approach(v, target, acceleration * APART)
    changing = abs(target - v) / acceleration
    way = HALF * (v + target) * changing + target * (APART - changing)
    return (way if reached == target else HALF * (v + reached) * APART), reached


@inline
def begin(lanes, k, r, speed, side):
    """Put a robot into lane k, to drive at `speed` [m/s] and `side` [m] to the left of its route."""
    motion = r["motion"]
    lanes[X * LANES + k], lanes[Y * LANES + k] = motion["x"], motion["y"]
    lanes[COS * LANES + k], lanes[SIN * LANES + k] = motion["cos"], motion["sin"]
    lanes[SPEED * LANES + k], lanes[STEER * LANES + k] = motion["speed"], motion["steer"]
    lanes[ALONG * LANES + k] = r["on_route"]["position"]
    lanes[LIMIT * LANES + k], lanes[SIDE * LANES + k] = speed, side


@inline
def aim(lanes, k, on_route, route, p):
    """Write the point that lane k steers for in the next step."""
    ahead = lanes[ALONG * LANES + k] + look_ahead(max(lanes[SPEED * LANES + k], ZERO), p)
    tx, ty, ux, uy = point_at(route, on_route["points"], on_route["spacing"], ahead, p["beyond"])
    side = lanes[SIDE * LANES + k]
    lanes[TARGET_X * LANES + k], lanes[TARGET_Y * LANES + k] = tx - side * uy, ty + side * ux


@inline
def drive(lanes, p):
    """Drive all lanes for a step towards their points, without branches and calls, to use vector instructions."""
    wheelbase, most, rate = p["wheelbase"], p["max_steer"], p["max_steer_rate"] * APART
    acceleration, fastest = p["max_acceleration"], p["max_speed"]
    for k in range(LANES):
        x, y, c, s = lanes[X * LANES + k], lanes[Y * LANES + k], lanes[COS * LANES + k], lanes[SIN * LANES + k]
        tx, ty, steer = lanes[TARGET_X * LANES + k], lanes[TARGET_Y * LANES + k], lanes[STEER * LANES + k]
        wanted, _, _ = pursue(x, y, c, s, tx, ty, wheelbase, most)
        limit = on_bend(lanes[LIMIT * LANES + k], wanted, steer, fastest)
        way, speed = driven(lanes[SPEED * LANES + k], limit, acceleration)
        to_steer = approach(steer, wanted, rate)
        mid_c, mid_s, to_c, to_s = turned(c, s, way * curvature(HALF * (steer + to_steer), wheelbase))
        lanes[X * LANES + k], lanes[Y * LANES + k] = x + way * mid_c, y + way * mid_s
        lanes[COS * LANES + k], lanes[SIN * LANES + k] = to_c, to_s
        lanes[SPEED * LANES + k], lanes[STEER * LANES + k], lanes[WAY * LANES + k] = speed, to_steer, way


@inline
def settle(lanes, k, on_route, route):
    """Write how far along its route lane k is after a step."""
    along, way = lanes[ALONG * LANES + k], lanes[WAY * LANES + k]
    x, y = lanes[X * LANES + k], lanes[Y * LANES + k]
    lanes[ALONG * LANES + k] = along_after(route, on_route["points"], on_route["spacing"], along, way, x, y)


@inline
def state_of(lanes, k):
    """Return x, y [m], the heading's cosine and sine, speed [m/s] and steering [rad] of lane k."""
    x, y, c, s = lanes[X * LANES + k], lanes[Y * LANES + k], lanes[COS * LANES + k], lanes[SIN * LANES + k]
    return x, y, c, s, lanes[SPEED * LANES + k], lanes[STEER * LANES + k]
