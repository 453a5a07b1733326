"""Broad phase: robots sorted into a uniform grid of buckets, so that the cost per robot does not grow with N."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.kinds import kind_of

SEARCH = 2  # buckets to either side that hold all robots within lidar range
FEW = 32  # robots up to which one bucket holds all of them
CENTRE_X, CENTRE_Y, COS, SIN, SPEED, SILENT = 0, 1, 2, 3, 4, 5  # rows of `bodies`
BODY = 6


def bucket_grid(num_robots: int, width: float, height: float, reach: float) -> tuple[int, int, float]:
    """Return (rows, columns, side [m]) of the buckets for a floor of width x height [m] and a search radius [m]."""
    if num_robots <= FEW:
        return 1, 1, 2.0 * max(width, height)
    side = reach / SEARCH
    return math.ceil(height / side) + 1, math.ceil(width / side) + 1, side


def scratch(count: int, p: Any) -> tuple[NDArray[Any], ...]:
    """Return the arrays that `sort` fills: order int32[N], starts int32[buckets + 2] and bodies float32[BODY, N]."""
    starts = np.empty(p["bucket_rows"] * p["bucket_columns"] + 2, np.int32)
    return np.empty(count, np.int32), starts, np.empty((BODY, count), np.float32)


@inline
def bucket_at(x, y, p):
    """Return (row, column) of the bucket of a point [m]."""
    row = min(max(int(y / p["bucket"]), 0), p["bucket_rows"] - 1)
    column = min(max(int(x / p["bucket"]), 0), p["bucket_columns"] - 1)
    return row, column


@inline
def _bucket_of(r, own, p):
    """Return the number of the bucket that holds the centre of a robot's body."""
    motion, offset = r["motion"], own["offset"]
    row, column = bucket_at(motion["x"] - offset * motion["cos"], motion["y"] - offset * motion["sin"], p)
    return row * p["bucket_columns"] + column


@part
def sort(robots, p, kinds, starts, order, bodies):
    """Sort all robots by the bucket of their body's centre, and write what others see of them.

    starts int32[rows x columns + 2]: where a bucket begins in `order` int32[N], the robots' indices, ascending within
    a bucket; so the buckets of one row from column a to b hold order[starts[row, a]:starts[row, b + 1]].
    bodies float32[BODY, N], in that order: centre x, y [m], cosine and sine of the heading, speed [m/s], 1 if silent.
    kinds: see kinds.py.
    """
    count = robots.shape[0]
    starts[:] = 0
    columns = p["bucket_columns"]
    if p["bucket_rows"] * columns == 1:
        starts[1] = count
        for i in range(count):
            order[i] = i
    else:
        for i in range(count):
            starts[_bucket_of(robots[i], kind_of(i, p, kinds), p) + 2] += 1
        for k in range(2, len(starts)):
            starts[k] += starts[k - 1]
        for i in range(count):  # moves each start on to the next bucket's
            after = _bucket_of(robots[i], kind_of(i, p, kinds), p) + 1
            order[starts[after]] = i
            starts[after] += 1
    for n in range(count):
        r, offset = robots[order[n]], kind_of(order[n], p, kinds)["offset"]
        c, s = r["motion"]["cos"], r["motion"]["sin"]
        bodies[CENTRE_X, n] = r["motion"]["x"] - offset * c
        bodies[CENTRE_Y, n] = r["motion"]["y"] - offset * s
        bodies[COS, n] = c
        bodies[SIN, n] = s
        bodies[SPEED, n] = r["motion"]["speed"]
        bodies[SILENT, n] = r["shield"]["silent"]
