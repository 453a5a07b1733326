"""Perception of a robot: lidar against shelves and robots, and its nearest robots. One call per robot.

For each edge and each robot, the lidar loops over all rays without a branch, which compiles to vector instructions.
"""

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline
from warehouse_env.observation import NEIGHBOUR
from warehouse_env.simulation.driver.line import to_go, way_point
from warehouse_env.simulation.physics.buckets import CENTRE_X, CENTRE_Y, COS, SEARCH, SILENT, SIN, SPEED, bucket_at
from warehouse_env.simulation.physics.discs import scan_discs
from warehouse_env.simulation.physics.floor import padded_cell
from warehouse_env.simulation.physics.geometry import ray_to_rectangle
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.trigonometry import ONE, PI, ZERO

_TWENTY = np.float32(20.0)
_FIVE = np.float32(5.0)
_SEAM = np.float32(2e-6)  # share of the range added to both ends of an edge, so that no ray slips between two
RAY_X, RAY_Y, PER_X, PER_Y = 0, 1, 2, 3  # rows of `turned`
TURNED = 4


def unit_vectors(rays: int) -> NDArray[np.float32]:
    """Return float32[2, rays]: the directions of rays, evenly all round, in the robot's frame."""
    angles = 2 * np.pi * np.arange(rays) / rays
    return np.stack([np.cos(angles), np.sin(angles)]).astype(np.float32)


@inline
def scan_shelves(eye, p, edges, rays, turned, out):
    """Write the distance [m] of each ray from an eye to the nearest shelf or disc, at most lidar_range.

    eye: x, y [m], cosine and sine of its heading; rays: float32[2, R], unit vectors in the robot's frame; turned:
    float32[TURNED, R], scratch. A ray of direction (ux, uy) from (cx, cy) meets the line x = a at a distance
    (a - cx) / ux, at y = cy + distance x uy; rounding moves that by less than half of a seam.
    """
    lines, seen, first = edges.edges, edges.seen, edges.first
    cx, cy, c, s = eye
    cell = p["cell"]
    for k in range(rays.shape[1]):
        ux = c * rays[0, k] - s * rays[1, k]
        uy = s * rays[0, k] + c * rays[1, k]
        turned[RAY_X, k] = ux
        turned[RAY_Y, k] = uy
        turned[PER_X, k] = ONE / ux
        turned[PER_Y, k] = ONE / uy
        out[k] = p["lidar_range"]
    row, column = padded_cell(cx, cy, cell, first)
    seam = _SEAM * p["lidar_range"]
    for n in range(first[row, column, 0], first[row, column, 1]):
        e = seen[n]
        _meet(lines[e, 0] - cx, lines[e, 1] - cy - seam, lines[e, 2] - cy + seam, turned[PER_X], turned[RAY_Y], out)
    for n in range(first[row, column, 1], first[row, column, 2]):
        e = seen[n]
        _meet(lines[e, 0] - cy, lines[e, 1] - cx - seam, lines[e, 2] - cx + seam, turned[PER_Y], turned[RAY_X], out)
    scan_discs(cx, cy, row, column, edges.discs, turned, out)


@inline
def _meet(line, low, high, per_across, beside, out):
    """Shorten the rays that meet an edge, all relative to their start. 0 x inf is nan: comparisons are False."""
    for k in range(per_across.shape[0]):
        distance = line * per_across[k]
        at = distance * beside[k]
        meets = (distance >= ZERO) & (distance < out[k]) & (at >= low) & (at <= high)
        out[k] = distance if meets else out[k]


@inline
def scan_robot(x, y, c, s, p, rays, out):
    """Shorten the rays that meet a robot whose centre is at (x, y) in the own frame, with relative heading (c, s)."""
    ox, oy = -(x * c + y * s), -(y * c - x * s)
    half_length, half_width = p["half_length"], p["half_width"]
    for k in range(rays.shape[1]):
        ux = rays[0, k] * c + rays[1, k] * s
        uy = rays[1, k] * c - rays[0, k] * s
        distance = ray_to_rectangle(ox, oy, ux, uy, half_length, half_width)
        out[k] = distance if distance < out[k] else out[k]


@inline
def _comes_before(squared, dx, dy, out, at):
    """Whether a robot is nearer than the one remembered at `at`; ties go by position, not by index."""
    if squared != out[at] or squared == np.float32(np.inf):
        return squared < out[at]
    return dx > out[at + 2] or (dx == out[at + 2] and dy > out[at + 3])


@inline
def _remember(squared, dx, dy, j, out, start, count):
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
def look_around(n, places, p, kinds, rays, out, start):
    """Scan all robots in range of the n-th of `bodies` into the lidar, and remember the nearest from out[start] on.

    Silent robots appear only in lidar. places: order, starts and bodies, see buckets.sort; p: its own.
    """
    order, starts, bodies = places
    c, s = bodies[COS, n], bodies[SIN, n]
    cx, cy = bodies[CENTRE_X, n], bodies[CENTRE_Y, n]
    count = p["neighbours"]
    for k in range(count):
        out[start + k * NEIGHBOUR] = np.float32(np.inf)
    lidar_range = p["lidar_range"]
    reach = lidar_range + p["widest"]
    columns = p["bucket_columns"]
    row, column = bucket_at(cx, cy, p)
    left, right = max(column - SEARCH, 0), min(column + SEARCH + 1, columns)
    for by in range(max(row - SEARCH, 0), min(row + SEARCH + 1, p["bucket_rows"])):
        for m in range(starts[by * columns + left], starts[by * columns + right]):
            dx, dy = bodies[CENTRE_X, m] - cx, bodies[CENTRE_Y, m] - cy
            squared = dx * dx + dy * dy
            if squared < reach * reach and m != n:
                other_c, other_s = bodies[COS, m], bodies[SIN, m]
                x, y = dx * c + dy * s, dy * c - dx * s
                turn_c, turn_s = other_c * c + other_s * s, other_s * c - other_c * s
                scan_robot(x, y, turn_c, turn_s, kind_of(order[m], p, kinds), rays, out)
                if count > 0 and squared < lidar_range * lidar_range and bodies[SILENT, m] == ZERO:
                    _remember(squared, dx, dy, m, out, start, count)


@inline
def write_neighbours(n, bodies, p, out, start, order, who):
    """Replace the remembered places in `bodies` by the neighbours' features (see observation_layout)."""
    c, s, v = bodies[COS, n], bodies[SIN, n], bodies[SPEED, n]
    scale, fast = ONE / p["lidar_range"], ONE / p["max_speed"]
    for k in range(p["neighbours"]):
        at = start + k * NEIGHBOUR
        if out[at] == np.float32(np.inf):
            for other in range(at, start + p["neighbours"] * NEIGHBOUR):
                out[other] = ZERO
            break
        m, dx, dy = int(out[at + 1]), out[at + 2], out[at + 3]
        turn_c = bodies[COS, m] * c + bodies[SIN, m] * s
        turn_s = bodies[SIN, m] * c - bodies[COS, m] * s
        out[at] = (dx * c + dy * s) * scale
        out[at + 1] = (dy * c - dx * s) * scale
        out[at + 2] = turn_c
        out[at + 3] = turn_s
        out[at + 4] = (bodies[SPEED, m] * turn_c - v) * fast
        out[at + 5] = bodies[SPEED, m] * turn_s * fast
        out[at + 6] = ONE
        who[k] = order[m]


@inline
def write_ego_and_route(r, route, p, out, start, at):
    """Write the slices `ego` and `route` (see observation_layout) from out[start] and from out[at] on."""
    motion, on_route = r["motion"], r["on_route"]
    out[start] = motion["speed"] / p["max_speed"]
    out[start + 1] = motion["steer"] / p["max_steer"]
    out[start + 2] = r["commanded"]["follow_steer"] / p["max_steer"]
    out[start + 3] = on_route["bearing"] / PI
    out[start + 4] = min(max(on_route["lateral"], -_FIVE), _FIVE)
    out[start + 5] = min(to_go(r), _TWENTY) / _TWENTY
    out[start + 6] = min(r["clocks"]["contact_time"], _FIVE) / _FIVE
    out[start + 7] = min(r["clocks"]["waiting_time"], _TWENTY) / _TWENTY
    for k in range(p["route_points"]):
        x, y, _, _ = way_point(r, route, np.float32(k + 1) * p["route_spacing"], ZERO)
        dx, dy = x - motion["x"], y - motion["y"]
        out[at] = (dx * motion["cos"] + dy * motion["sin"]) / _FIVE
        out[at + 1] = (dy * motion["cos"] - dx * motion["sin"]) / _FIVE
        at += 2
