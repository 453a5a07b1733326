"""Plain NumPy float64 answers to hold the kernels against; shares no code with them. Frames and units as theirs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]  # [..., 2], [m]

LENGTH, WIDTH, FRONT, WHEELBASE = 0.9, 0.6, 0.15, 0.6  # [m], the default robot, written down once more by hand
REAR = LENGTH - FRONT
OFFSET = LENGTH / 2 - FRONT  # front axle to the body's centre


def rectangle(x: float, y: float, heading: float, half_length: float, half_width: float) -> Points:
    """Corners [4, 2], counter-clockwise from the front left."""
    c, s = math.cos(heading), math.sin(heading)
    local = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (half_length, half_width)
    return local @ np.array([[c, s], [-s, c]]) + (x, y)


def bodies(
    x: Points, y: Points, heading: Points, length: Points | float = LENGTH, width: Points | float = WIDTH,
    front: Points | float = FRONT,
) -> Points:  # fmt: skip
    """Corners [..., 4, 2] of robots whose front axles are at (x, y): default ones, or of the sizes given [...]."""
    x, y, heading = (np.asarray(a, dtype=np.float64) for a in (x, y, heading))
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)[..., None, :]
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)[..., None, :]
    length, width, front = (np.asarray(a, dtype=np.float64)[..., None] for a in (length, width, front))
    along = (np.array([0, -1, -1, 0]) * length + front)[..., None]
    aside = (np.array([1, 1, -1, -1]) * width / 2)[..., None]
    return np.stack([x, y], axis=-1)[..., None, :] + along * ahead + aside * left


def separation(a: Points, b: Points) -> NDArray[np.float64]:
    """Widest gap [...] between convex polygons a, b [..., K, 2] over their edges' normals; negative: they overlap.

    Its sign is exact; where positive it is a lower bound of the distance.
    """
    widest = None
    for polygon in (a, b):
        edges = np.roll(polygon, -1, axis=-2) - polygon
        normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1)
        normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
        on_a = np.einsum("...kd,...nd->...nk", a, normals)
        on_b = np.einsum("...kd,...nd->...nk", b, normals)
        gaps = np.maximum(on_b.min(-1) - on_a.max(-1), on_a.min(-1) - on_b.max(-1)).max(-1)
        widest = gaps if widest is None else np.maximum(widest, gaps)
    return np.asarray(widest)


def _point_to_segment(p: Points, a: Points, b: Points) -> float:
    along = b - a
    t = min(max(float((p - a) @ along) / float(along @ along), 0.0), 1.0)
    return float(np.linalg.norm(p - (a + t * along)))


def on_arcs(
    pose: Points, speed: Points, steer: Points, seconds: float, count: int, wheelbase: Points | float = WHEELBASE
) -> Points:
    """Poses [count + 1, ..., 3] of the front axle at even times of a substep, from pose [..., 3] on.

    speed, steer: [..., 2], at its beginning and its end; the speed changes evenly, the wheels stand at their mean.
    """
    t = np.linspace(0.0, seconds, count + 1).reshape(-1, *([1] * speed[..., 0].ndim))
    way = speed[..., 0] * t + (speed[..., 1] - speed[..., 0]) * t * t / (2 * seconds)
    bend = -np.tan(steer.mean(-1)) / wheelbase
    heading = pose[..., 2] + way * bend
    straight = np.abs(bend) < 1e-12
    radius = 1.0 / np.where(straight, 1.0, bend)
    dx = np.where(straight, way * np.cos(pose[..., 2]), radius * (np.sin(heading) - np.sin(pose[..., 2])))
    dy = np.where(straight, way * np.sin(pose[..., 2]), radius * (np.cos(pose[..., 2]) - np.cos(heading)))
    return np.stack([pose[..., 0] + dx, pose[..., 1] + dy, heading], axis=-1)


def polygon_distance(a: Points, b: Points) -> float:
    """Distance [m] of two convex polygons [K, 2]: every corner of one against every edge of the other."""
    if separation(a, b) <= 0:
        return 0.0
    return min(
        _point_to_segment(p, other[k], other[(k + 1) % len(other)])
        for one, other in ((a, b), (b, a))
        for p in one
        for k in range(len(other))
    )


def ray_to_polygon(origin: Points, angle: float, polygon: Points) -> float:
    """Distance [m] along a ray to the first edge of a polygon it crosses, 0 from inside, inf if it meets none."""
    u = np.array([math.cos(angle), math.sin(angle)])
    best, crossings = math.inf, 0
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        edge = b - a
        det = u[1] * edge[0] - u[0] * edge[1]
        if det == 0.0:
            continue
        to = a - origin
        t = (to[1] * edge[0] - to[0] * edge[1]) / det
        along = (u[0] * to[1] - u[1] * to[0]) / det
        if t >= 0 and 0 <= along <= 1:
            best = min(best, t)
            crossings += 1
    return 0.0 if crossings % 2 == 1 else best


def shelves(occupied: NDArray[np.bool_], cell: float = 1.0, grow: float = 0.0) -> Points:
    """Corners [K, 4, 2] of all shelf cells and of four long walls around the map, each grown by `grow` [m]."""
    rows, columns = occupied.shape
    boxes = [
        (column * cell, (rows - 1 - row) * cell, (column + 1) * cell, (rows - row) * cell)
        for row, column in np.argwhere(occupied).tolist()
    ]
    far, right, top = 100.0, columns * cell, rows * cell
    boxes += [(-far, -far, 0, top + far), (right, -far, right + far, top + far)]
    boxes += [(-far, -far, right + far, 0), (-far, top, right + far, top + far)]
    return np.array(
        [
            [(x2 + grow, y2 + grow), (x1 - grow, y2 + grow), (x1 - grow, y1 - grow), (x2 + grow, y1 - grow)]
            for x1, y1, x2, y2 in boxes
        ]
    )


def around(discs: NDArray[np.floating[Any]]) -> Points:
    """Corners [K, 48, 2] of polygons just around discs (x, y, radius) [m]: a 500th wider at their corners."""
    angles = 2 * math.pi * np.arange(48) / 48
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1) / math.cos(math.pi / 48)
    return np.asarray(discs[:, None, :2] + discs[:, None, 2:] * ring, dtype=np.float64)


def deepest_overlap(x: Points, y: Points, heading: Points, walls: Points) -> float:
    """Depth [m] of the worst overlap of robots [N] with each other or with walls [K, 4, 2]; negative if none."""
    robots = bodies(x, y, heading)
    worst = -float(separation(robots[:, None], walls[None]).min())
    first, second = np.triu_indices(len(robots), 1)
    if len(first):
        worst = max(worst, -float(separation(robots[first], robots[second]).min()))
    return worst
