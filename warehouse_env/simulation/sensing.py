"""What a robot perceives: lidar against shelves and robots, and its nearest robots. One call a robot."""

from __future__ import annotations

import numpy as np

from warehouse_env.observation import EGO, NEIGHBOUR
from warehouse_env.simulation.buckets import SEARCH, bucket_at
from warehouse_env.simulation.geometry import ray_to_rectangle
from warehouse_env.simulation.kernel import inline
from warehouse_env.simulation.tracking import way_point
from warehouse_env.simulation.trigonometry import HALF_PI, ONE, PI, TWO_PI, ZERO, arc_tan2

_TWENTY = np.float32(20.0)
_FIVE = np.float32(5.0)
_BEFORE = np.float32(2e-5)  # [cells] before a crossing, so that no ray slips between shelves that touch at a corner


@inline
def scan_shelves(cx, cy, c, s, lidar_range, solid, cell, rays, out):  # type: ignore[no-untyped-def]
    """Write the distance [m] of each ray from (cx, cy) to the nearest shelf, at most lidar_range.

    rays: float32[R, 2], unit vectors in the robot's frame; (c, s) its heading. A ray meets a shelf where it crosses
    into its column or into its row: two loops whose steps do not wait for each other.
    """
    gx, gy = cx / cell + ONE, cy / cell + ONE
    first_column, first_row = int(gx), int(gy)
    left, below = gx - np.float32(first_column), gy - np.float32(first_row)
    east, north = np.float32(solid.shape[1] - 1) - gx, np.float32(solid.shape[0] - 1) - gy
    reach = lidar_range / cell
    for k in range(rays.shape[0]):
        ux = c * rays[k, 0] - s * rays[k, 1]
        uy = s * rays[k, 0] + c * rays[k, 1]
        dx, dy = abs(ONE / ux), abs(ONE / uy)
        best = min(reach, min((east if ux > ZERO else gx - ONE) * dx, (north if uy > ZERO else gy - ONE) * dy))
        t = (ONE - left if ux > ZERO else left) * dx
        step = 1 if ux > ZERO else -1
        column = first_column
        while t < best:
            column += step
            if solid[int(gy + uy * (t - _BEFORE)), column] != 0:
                best = t
                break
            t += dx
        t = (ONE - below if uy > ZERO else below) * dy
        step = 1 if uy > ZERO else -1
        row = first_row
        while t < best:
            row += step
            if solid[row, int(gx + ux * (t - _BEFORE))] != 0:
                best = t
                break
            t += dy
        out[k] = best * cell


@inline
def scan_robot(x, y, squared, c, s, p, rays, out):  # type: ignore[no-untyped-def]
    """Shorten the rays that meet a robot whose centre is at (x, y) in the own frame, with relative heading (c, s)."""
    count = rays.shape[0]
    radius = p["radius"]
    outside = squared - radius * radius
    spread = arc_tan2(radius, np.sqrt(outside)) if outside > ZERO else HALF_PI
    if outside <= ZERO:
        spread = PI
    step = TWO_PI / np.float32(count)
    middle = arc_tan2(y, x)
    first = int(np.ceil((middle - spread) / step))
    last = int(np.floor((middle + spread) / step))
    last = min(last, first + count - 1)
    ox, oy = -(x * c + y * s), -(y * c - x * s)
    for index in range(first, last + 1):
        k = index % count
        ux = rays[k, 0] * c + rays[k, 1] * s
        uy = rays[k, 1] * c - rays[k, 0] * s
        distance = ray_to_rectangle(ox, oy, ux, uy, p["half_length"], p["half_width"])
        if distance < out[k]:
            out[k] = distance


@inline
def _comes_before(squared, dx, dy, out, at):  # type: ignore[no-untyped-def]
    """Is a robot nearer than the one remembered at `at`? Equally near ones go by where they are, not by index."""
    if squared != out[at] or squared == np.float32(np.inf):
        return squared < out[at]
    return dx > out[at + 2] or (dx == out[at + 2] and dy > out[at + 3])


@inline
def _remember(squared, dx, dy, j, out, start, count):  # type: ignore[no-untyped-def]
    """Keep the nearest robots sorted in `out` itself: (squared distance, index, dx, dy) at the head of each entry."""
    k = count - 1
    if not _comes_before(squared, dx, dy, out, start + k * NEIGHBOUR):
        return
    while k > 0 and _comes_before(squared, dx, dy, out, start + (k - 1) * NEIGHBOUR):
        for m in range(4):
            out[start + k * NEIGHBOUR + m] = out[start + (k - 1) * NEIGHBOUR + m]
        k -= 1
    out[start + k * NEIGHBOUR] = squared
    out[start + k * NEIGHBOUR + 1] = np.float32(j)
    out[start + k * NEIGHBOUR + 2] = dx
    out[start + k * NEIGHBOUR + 3] = dy


@inline
def look_around(i, robots, heads, nexts, bucket_size, p, rays, out, start):  # type: ignore[no-untyped-def]
    """Scan all robots in range of robot i into the lidar, and remember the nearest from out[start] on."""
    r = robots[i]
    c, s = r["cos"], r["sin"]
    cx, cy = r["x"] - p["offset"] * c, r["y"] - p["offset"] * s
    count = p["neighbours"]
    for k in range(count):
        out[start + k * NEIGHBOUR] = np.float32(np.inf)
    reach = p["lidar_range"] + p["radius"]
    row, column = bucket_at(cx, cy, heads, bucket_size)
    for by in range(max(row - SEARCH, 0), min(row + SEARCH + 1, heads.shape[0])):
        for bx in range(max(column - SEARCH, 0), min(column + SEARCH + 1, heads.shape[1])):
            j = heads[by, bx]
            while j >= 0:
                o = robots[j]
                dx = o["x"] - p["offset"] * o["cos"] - cx
                dy = o["y"] - p["offset"] * o["sin"] - cy
                squared = dx * dx + dy * dy
                if squared < reach * reach and j != i:
                    _see(o, dx, dy, squared, c, s, p, rays, out)
                    if squared < p["lidar_range"] * p["lidar_range"]:
                        _remember(squared, dx, dy, j, out, start, count)
                j = nexts[j]


@inline
def _see(o, dx, dy, squared, c, s, p, rays, out):  # type: ignore[no-untyped-def]
    other_c, other_s = o["cos"], o["sin"]
    scan_robot(
        dx * c + dy * s,
        dy * c - dx * s,
        squared,
        other_c * c + other_s * s,
        other_s * c - other_c * s,
        p,
        rays,
        out,
    )


@inline
def write_neighbours(i, robots, p, out, start):  # type: ignore[no-untyped-def]
    """Replace the remembered indices by the neighbours' features (see observation_layout)."""
    r = robots[i]
    c, s, v = r["cos"], r["sin"], r["speed"]
    cx, cy = r["x"] - p["offset"] * c, r["y"] - p["offset"] * s
    scale, fast = ONE / p["lidar_range"], ONE / p["max_speed"]
    for k in range(p["neighbours"]):
        at = start + k * NEIGHBOUR
        if out[at] == np.float32(np.inf):
            for m in range(NEIGHBOUR):
                out[at + m] = ZERO
            continue
        o = robots[int(out[at + 1])]
        dx = o["x"] - p["offset"] * o["cos"] - cx
        dy = o["y"] - p["offset"] * o["sin"] - cy
        turn_c, turn_s = o["cos"] * c + o["sin"] * s, o["sin"] * c - o["cos"] * s
        out[at] = (dx * c + dy * s) * scale
        out[at + 1] = (dy * c - dx * s) * scale
        out[at + 2] = turn_c
        out[at + 3] = turn_s
        out[at + 4] = (o["speed"] * turn_c - v) * fast
        out[at + 5] = o["speed"] * turn_s * fast
        out[at + 6] = ONE


@inline
def write_ego_and_route(r, route, p, out, start):  # type: ignore[no-untyped-def]
    """Write the slices `ego` and `route` (see observation_layout) from out[start] on."""
    to_go = np.float32(r["points"] - 1) * r["spacing"] - r["position"]
    out[start] = r["speed"] / p["max_speed"]
    out[start + 1] = r["steer"] / p["max_steer"]
    out[start + 2] = r["follow_steer"] / p["max_steer"]
    out[start + 3] = r["bearing"] / PI
    out[start + 4] = min(max(r["lateral"], -_FIVE), _FIVE)
    out[start + 5] = min(to_go, _TWENTY) / _TWENTY
    out[start + 6] = min(r["contact_time"], _FIVE) / _FIVE
    out[start + 7] = min(r["waiting_time"], _TWENTY) / _TWENTY
    at = start + EGO
    for k in range(p["route_points"]):
        x, y, _, _ = way_point(r, route, np.float32(k + 1) * p["route_spacing"])
        dx, dy = x - r["x"], y - r["y"]
        out[at] = (dx * r["cos"] + dy * r["sin"]) / _FIVE
        out[at + 1] = (dy * r["cos"] - dx * r["sin"]) / _FIVE
        at += 2
