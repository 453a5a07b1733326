"""Stand robots at the start: on distinct endpoints, facing along their first route, touching nothing."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.kernel import inline, kernel, part
from warehouse_env.simulation.driver import line
from warehouse_env.simulation.physics.floor import Floor
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import body_of, grown, rectangle_gap, squared_distance
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.trigonometry import ZERO, sin_cos

Limits = tuple[NDArray[Any], NDArray[Any] | None]
"""PARAMETERS[1] of a world's robots, and PARAMETERS[N] of each where these are not all alike."""
GAP = np.float32(0.15)  # [m] to robots at the start, half of it to shelves
TOUCH = np.float32(1e-6)  # [m] of gap under which bodies touch
TURNS = (0, 1, -1, 2, -2, 3, -3, 4)  # eighths of a circle tried off the route's direction
_EIGHTH, _WITHIN = math.pi / 4, math.tan(math.pi / 8)
# [rad] of so many eighths more than -8
_HEADINGS = np.array([math.remainder(k * _EIGHTH, 2 * math.pi) for k in range(-8, 9)], np.float32)


@part
def _fits(robots, index, pose, p, kinds, floor, gap):
    """Whether robot `index` at a pose (x, y, heading) keeps `gap` from those before it and half of it from shelves."""
    x, y, heading = pose
    s, c = sin_cos(heading)
    own = kind_of(index, p, kinds)
    body = body_of(x, y, c, s, own)
    if body_touches_shelf(grown(body, np.float32(0.5) * gap), floor):
        return False
    for j in range(index):
        o, kind = robots[j], kind_of(j, p, kinds)
        motion, reach = o["motion"], own["radius"] + kind["radius"] + gap
        other = body_of(motion["x"], motion["y"], motion["cos"], motion["sin"], kind)
        if squared_distance(body, other) < reach * reach and gap > rectangle_gap(body, other):
            return False
    return True


@part
def _put(robots, index, pose):
    """Put robot `index` at a pose, where its time of standing begins."""
    r = robots[index]
    motion, clocks = r["motion"], r["clocks"]
    motion["x"], motion["y"], motion["heading"] = pose
    motion["sin"], motion["cos"] = sin_cos(pose[2])
    clocks["anchor_x"], clocks["anchor_y"] = pose[0], pose[1]


@inline
def _eighths(dx, dy):
    """Return the direction (dx, dy) as the nearest eighth of a circle, -4..4."""
    across, along = abs(dy), abs(dx)
    k = 0 if across <= along * _WITHIN else 2 if along < across * _WITHIN else 1
    k = k if dx >= 0 else 4 - k
    return k if dy >= 0 else -k


@kernel
def stand_facing(robots, index, start, p, kinds, floor):
    """Put robot `index` of ROBOT[N] on a start, facing its direction as nearly as fits; return whether anything fits.

    start: (x, y) [m] and a direction (x, y). Robots 0..index-1 stand already.
    """
    x, y, first = np.float32(start[0]), np.float32(start[1]), _eighths(start[2], start[3])
    for turn in TURNS:
        pose = x, y, _HEADINGS[8 + first + turn]
        if _fits(robots, index, pose, p, kinds, floor, GAP):
            _put(robots, index, pose)
            return True
    return False


@part
def _nearest(route, points, x, y):
    """Return the number of the way-point that is nearest to (x, y), among the first `points`."""
    best, nearest = np.float32(np.inf), 0
    for k in range(points):
        dx, dy = route[k, 0] - x, route[k, 1] - y
        if dx * dx + dy * dy < best:
            best, nearest = dx * dx + dy * dy, k
    return nearest


@kernel
def _put_all(robots, routes, pose, speed, params, kinds, floor):
    """Put robots ROBOT[B, N] at pose float32[B, N, 3], driving at speed float32[B, N] [m/s], wheels straight, beside
    the nearest points of their routes float32[B, N, R, 2] [m]; return bool[B]: whether nothing of a world touches.
    """
    p = params[0]
    free = np.ones(robots.shape[0], np.bool_)
    for b in range(robots.shape[0]):
        for i in range(robots.shape[1]):
            r, x, y = robots[b, i], pose[b, i, 0], pose[b, i, 1]
            on_route, at = r["on_route"], (x, y, pose[b, i, 2])
            free[b] = free[b] and _fits(robots[b], i, at, p, kinds, floor, TOUCH)
            _put(robots[b], i, at)
            r["motion"]["speed"], r["motion"]["steer"] = speed[b, i], ZERO
            on_route["position"] = np.float32(_nearest(routes[b, i], on_route["points"], x, y)) * on_route["spacing"]
            line.locate(r, routes[b, i])
            line.aim(r, routes[b, i], kind_of(i, p, kinds))
    return free


def put_all(
    robots: NDArray[Any], routes: NDArray[np.float32], pose: NDArray[Any], speed: NDArray[Any], limits: Limits,
    floor: Floor,
) -> NDArray[np.bool_]:  # fmt: skip
    """Put robots ROBOT[B, N] at poses [B, N, 3] with speeds [B, N], as poses.py returns them; see `_put_all`."""
    given = pose.astype(np.float32), speed.astype(np.float32)
    free: NDArray[np.bool_] = _put_all(robots, routes, *given, *limits, floor)
    return free


def stand(robots: NDArray[Any], index: int, pose: NDArray[np.float64], limits: Limits, floor: Floor) -> None:
    """Stand robot `index` of ROBOT[N] at a pose (x [m], y [m], heading [rad]); ConfigError if it touches something."""
    x, y, heading = pose.astype(np.float32)
    if not _fits(robots, index, (x, y, heading), limits[0][0], limits[1], floor, TOUCH):
        raise ConfigError(
            f"robot {index} touches a shelf or another robot at ({x:.3f}, {y:.3f}), heading {heading:.3f}"
        )
    _put(robots, index, (x, y, heading))
