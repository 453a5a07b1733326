"""Broad phase: a uniform grid of buckets, each a linked list of robots, so cost per robot does not grow with N."""

from __future__ import annotations

import math

import numpy as np

from warehouse_env.simulation.kernel import inline

SEARCH = 2  # buckets to either side that hold all robots within lidar range
FEW = 32  # robots up to which one bucket holds all of them


def bucket_grid(num_robots: int, width: float, height: float, reach: float) -> tuple[int, int, float]:
    """Return (rows, columns, side [m]) of the buckets for a floor of width x height [m], looked around `reach` [m]."""
    if num_robots <= FEW:
        return 1, 1, 2.0 * max(width, height)
    side = reach / SEARCH
    return math.ceil(height / side) + 1, math.ceil(width / side) + 1, side


@inline
def bucket_at(x, y, heads, side):  # type: ignore[no-untyped-def]
    """Return (row, column) of the bucket of a point [m]."""
    row = min(max(int(y / side), 0), heads.shape[0] - 1)
    column = min(max(int(x / side), 0), heads.shape[1] - 1)
    return row, column


@inline
def fill(robots, heads, nexts, offset, side):  # type: ignore[no-untyped-def]
    """Sort all robots by their body's centre. heads int32[rows, columns], nexts int32[N]; -1 ends a list."""
    heads[:, :] = np.int32(-1)
    for i in range(robots.shape[0] - 1, -1, -1):
        r = robots[i]
        row, column = bucket_at(r["x"] - offset * r["cos"], r["y"] - offset * r["sin"], heads, side)
        nexts[i] = heads[row, column]
        heads[row, column] = i
