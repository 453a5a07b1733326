"""Predictions: for every (speed level, lateral offset), the time until the body would touch a neighbour.

An optional slice of the observation, computed from its other slices. The own body moves along the route, from its
present lateral offset to the commanded one, while the speed changes at the vehicle's acceleration. Neighbours drive
straight on and are as large as the largest robot of the fleet. Both are approximations.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.observation import NEIGHBOUR
from warehouse_env.simulation.physics.geometry import (
    Rectangle,
    body_at,
    grown,
    rectangles_touch,
    square_at,
    squared_distance,
)
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, PI, ZERO, sin_cos

HORIZON = np.float32(2.4)  # [s]
SAMPLES = 8  # times within the horizon
SETTLE = np.float32(1.5)  # [m] of driving in which a lateral offset is reached
MARGIN = np.float32(0.03)  # [m] kept at first
MARGIN_RATE = np.float32(0.05)  # [m/s] added to it over time
TURNING = np.float32(1.2)  # [rad] of bearing from which the robot turns on the spot
TURN_SIDE = np.float32(0.75)  # [m] half the side of the square that a turn on the spot may sweep
_FIVE = np.float32(5.0)
_SHORT = np.float32(1e-3)
_DIAGONAL = np.float32(1.4143)  # of a unit square, rounded up


# Rows of `legs` float32[LEGS, route_points], the route between its points: begin (x, y), the way to its end (x, y) [m],
# its direction (x, y).
FROM_X, FROM_Y, LEG_X, LEG_Y, ALONG_X, ALONG_Y = range(6)
LEGS = 6
# Where the SAMPLES values of each quantity begin in `path` float32[PATH], for one speed: time [s], distance driven [m]
# and in legs, the front axle without an offset (x, y), the route's direction there (x, y), the share of the present
# lateral offset that is left, and whether the neighbour is near. Constants, so that the compiler sees no overlap.
TIME, ALONG, LEGS_PASSED, PATH_X, PATH_Y, UNIT_X, UNIT_Y, LEFT, CLOSE = range(0, 9 * SAMPLES, SAMPLES)
PATH = 9 * SAMPLES


@inline
def travel(speed, target, acceleration, t):
    """Return the metres driven in t [s] while the speed changes to `target` at the given rate."""
    rise = abs(target - speed) / acceleration
    sign = ONE if target > speed else -ONE
    rising = speed * t + HALF * sign * acceleration * t * t
    risen = HALF * (speed + target) * rise + target * (t - rise)
    return rising if t <= rise else risen


@inline
def _lay_out_route(row, ego, route, p, legs):
    """Fill `legs`, from the route's foot point beside the robot to its last route point."""
    sine, cosine = sin_cos(row[ego + 3] * PI)
    x, y = row[ego + 4] * sine, -row[ego + 4] * cosine
    for k in range(p["route_points"]):
        to_x, to_y = _FIVE * row[route + 2 * k], _FIVE * row[route + 2 * k + 1]
        dx, dy = to_x - x, to_y - y
        norm = np.sqrt(dx * dx + dy * dy)
        known = norm >= _SHORT
        legs[FROM_X, k], legs[FROM_Y, k] = x, y
        legs[LEG_X, k], legs[LEG_Y, k] = dx if known else ZERO, dy if known else ZERO
        legs[ALONG_X, k], legs[ALONG_Y, k] = dx / norm if known else ONE, dy / norm if known else ZERO
        x, y = to_x, to_y


@inline
def _lay_out_path(v0, speed, p, legs, path):
    """Fill `path` for a speed: along the route forwards, along the heading backwards."""
    acceleration, spacing, last = p["max_acceleration"], p["route_spacing"], p["route_points"] - 1
    for k in range(SAMPLES):
        t = HORIZON * np.float32(k + 1) / np.float32(SAMPLES)
        along = travel(v0, speed, acceleration, t)
        path[TIME + k], path[ALONG + k] = t, along
        path[LEGS_PASSED + k] = max(along, ZERO) / spacing
        path[LEFT + k] = max(ZERO, ONE - along / SETTLE)
    for k in range(SAMPLES):  # apart from the loop above, which compiles to vector instructions
        along, legs_passed = path[ALONG + k], path[LEGS_PASSED + k]
        at = min(int(legs_passed), last)
        part = min(legs_passed - np.float32(at), ONE)
        x, y = legs[FROM_X, at] + part * legs[LEG_X, at], legs[FROM_Y, at] + part * legs[LEG_Y, at]
        path[PATH_X + k] = x if along > ZERO else along
        path[PATH_Y + k] = y if along > ZERO else ZERO
        path[UNIT_X + k], path[UNIT_Y + k] = legs[ALONG_X, at], legs[ALONG_Y, at]


@inline
def _touches(x, y, c, s, margin, other, p):
    """Whether the body with its front axle at (x, y), grown by `margin` [m], touches the other, a Rectangle."""
    far = p["radius"] + p["widest"] + _DIAGONAL * margin
    # the frame's origin is the own body's centre now
    body = grown(body_at(x - p["offset"] * c + p["offset"], y - p["offset"] * s, c, s, p), margin)
    return squared_distance(body, other) < far * far and rectangles_touch(body, other)


@inline
def _turns_into(other, p):
    """Whether the square that a turn on the spot may sweep touches the other body."""
    far = p["widest"] + _DIAGONAL * TURN_SIDE
    square = square_at(ZERO, ZERO, TURN_SIDE)
    return squared_distance(square, other) < far * far and rectangles_touch(square, other)


@inline
def _offset_touches(path, k, lateral, offset, margin, other, p):
    """Whether the body, on its way from `lateral` to `offset` [m] beside the route, touches the other."""
    ux, uy, left = path[UNIT_X + k], path[UNIT_Y + k], path[LEFT + k]
    side = offset + (lateral - offset) * left
    x, y = path[PATH_X + k] - side * uy, path[PATH_Y + k] + side * ux
    far = p["radius"] + p["widest"] + _DIAGONAL * margin + abs(p["offset"])  # however the body stands about its axle
    gap_x, gap_y = other.x - x - p["offset"], other.y - y
    if gap_x * gap_x + gap_y * gap_y > far * far:
        return False
    slope = (offset - lateral) / SETTLE if left > ZERO else ZERO
    norm = np.sqrt(ONE + slope * slope)
    c, s = (ux - slope * uy) / norm, (uy + slope * ux) / norm
    return _touches(x, y, c, s, margin, other, p)


@inline
def _conflicts(out, commands, path, k, lateral, turning, other, p):
    """Enter the conflicts at time k of commands of one speed with one neighbour, a Rectangle.

    out: the slice; commands: (table, begin, end).
    """
    table, at, end = commands
    share = np.float32(k) / np.float32(SAMPLES)
    margin = MARGIN + MARGIN_RATE * path[TIME + k]
    for a in range(at, end):
        if out[a] <= share:  # an earlier one
            continue
        if turning:
            touches = _turns_into(other, p)
        elif path[ALONG + k] <= ZERO:
            touches = _touches(path[PATH_X + k], ZERO, ONE, ZERO, margin, other, p)
        else:
            offset = table[a, 1] if table[a, 0] > ZERO else ZERO
            touches = _offset_touches(path, k, lateral, offset, margin, other, p)
        if touches:
            out[a] = share


@inline
def _mark_close(x, y, vx, vy, bodies, offset, path):
    """Mark in `path` when a body, now at (x, y), is within `bodies` [m] plus the margin; return the count."""
    count = np.int32(0)
    for k in range(SAMPLES):
        reach = bodies + _DIAGONAL * MARGIN_RATE * path[TIME + k]
        gap_x, gap_y = x + vx * path[TIME + k] - path[PATH_X + k] - offset, y + vy * path[TIME + k] - path[PATH_Y + k]
        near = gap_x * gap_x + gap_y * gap_y < reach * reach
        path[CLOSE + k] = ONE if near else ZERO
        count += np.int32(1) if near else np.int32(0)
    return count


@inline
def _look(out, seen, commands, path, v0, lateral, turning, p):
    """Enter all conflicts of commands with the neighbours `seen`, except those far from the path.

    out, commands: see `_conflicts`; v0 [m/s]: the own speed.
    """
    table, at, end = commands
    widest = abs(lateral)
    if table[at, 0] > ZERO:
        for a in range(at, end):
            widest = max(widest, abs(table[a, 1]))
    bodies = p["radius"] + p["widest"] + abs(p["offset"]) + widest + _DIAGONAL * MARGIN
    for entry in range(0, seen.shape[0], NEIGHBOUR):
        x, vx = seen[entry] * p["lidar_range"], seen[entry + 4] * p["max_speed"] + v0
        y, vy = seen[entry + 1] * p["lidar_range"], seen[entry + 5] * p["max_speed"]
        if not turning and _mark_close(x, y, vx, vy, bodies, p["offset"], path) == 0:
            continue
        for k in range(SAMPLES):
            if turning or path[CLOSE + k] != ZERO:
                other = Rectangle(
                    x + vx * path[TIME + k], y + vy * path[TIME + k], seen[entry + 2], seen[entry + 3],
                    p["widest_length"], p["widest_width"],
                )  # fmt: skip
                _conflicts(out, commands, path, k, lateral, turning, other, p)


@inline
def write_predictions(row, starts, table, legs, path, p):
    """Write the slice `predictions`: the share of HORIZON until each command would touch a neighbour, 1 if none.

    row: the observation float32[D] with all other slices; starts: observation.Starts; table float32[K, 2]: commands
    (speed, offset) grouped by speed; legs, path: scratch. Braking, backing and turning on the spot do not depend on the
    offset and are computed once.
    """
    ego, route, near, start = starts.ego, starts.route, starts.neighbours, starts.predictions
    others, out = 0, row[start : start + table.shape[0]]
    while others < p["neighbours"] and row[near + others * NEIGHBOUR + 6] != ZERO:
        others += 1
    seen = row[near : near + others * NEIGHBOUR]
    for a in range(table.shape[0]):
        out[a] = ONE
    if others > 0:
        _lay_out_route(row, ego, route, p, legs)
    at = 0
    while others > 0 and at < table.shape[0]:
        speed = table[at, 0]
        end = at + 1
        while end < table.shape[0] and table[end, 0] == speed:
            end += 1
        turning = abs(row[ego + 3] * PI) > TURNING and speed > ZERO
        count = end - at if speed > ZERO and not turning else 1
        _lay_out_path(row[ego] * p["max_speed"], speed, p, legs, path)
        _look(out, seen, (table, at, at + count), path, row[ego] * p["max_speed"], row[ego + 4], turning, p)
        for a in range(at + count, end):
            out[a] = out[at]
        at = end
