"""The table of reservations: which pose of a path touches which poses of others, as bits.

All poses are listed by square of the floor, so each pose is compared only with those near it.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part, whole
from warehouse_env.simulation.physics.geometry import body_at, grown, rectangles_touch, squared_distance
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.traffic.path_ahead import CENTRE_X, CENTRE_Y, COS, POSES, SIN

WIDE = np.float32(0.04)  # [m] of room around bodies in what is granted anew: paths are predictions
TIGHT = np.float32(0.008)  # [m] around bodies that are near, and in what has been granted before: less than the field
NEARBY = 2  # poses from where it is that are predicted well
ACROSS = np.float32(0.5)  # cosine of the angle from which one crosses another's path, rather than going along with it
SQUARES = 64  # on a side, then from the first again: a power of two
PLACES = 5  # of bits that number the poses of a path
BIT = np.uint32(1)
TOUCH_WIDE, TOUCH_TIGHT, CROSS = range(3)  # of masks uint32[3, N, POSES]
COUNT, WHO, NUMBER, GRANT, MUST, ASKED = range(6)  # rows of numbers int32[6, N + 1]


class ReservationTable(NamedTuple):
    """The paths ahead of N robots, what has been granted of them, and where they touch."""

    paths: NDArray[np.float32]  # [N + 1, POSES, COLUMNS], the bodies ahead; the last row is for trials
    first: NDArray[np.int32]  # [SQUARES, SQUARES], a pose in each square
    following: NDArray[np.int32]  # [N * POSES], of each pose the next one in its square, -1: none
    masks: NDArray[np.uint32]  # [3, N, POSES], by kind (TOUCH_WIDE ...), the n-th robot that a path meets, and pose of
    # the path: a bit for each pose of that robot
    numbers: NDArray[np.int32]  # [6, N + 1], rows COUNT ...: poses of a path; the n-th robot met; as which number a
    # robot was met; poses granted; poses in which a robot can stop; whether it has been asked


def scratch(count: int) -> tuple[NDArray[Any], ...]:
    """Return all arrays of a ReservationTable of `count` robots but the paths, which are kept between decisions."""
    squares = SQUARES if count else 0
    return (
        np.empty((squares, squares), np.int32), np.empty(count * POSES, np.int32),
        np.empty((3, count, POSES), np.uint32), np.zeros((6, count + 1), np.int32),
    )  # fmt: skip


@inline
def _reach(p):
    """Return the distance [m] of any two centres from which bodies do not touch, with WIDE room; side of a square."""
    return p["widest"] + p["widest"] + WIDE + WIDE + WIDE


@inline
def _square(x, reach):
    """Return the row or column of the square of a coordinate [m]."""
    return int(np.floor(x / reach)) & (SQUARES - 1)


@part
def enlist(table, p):
    """Put all poses of all paths into the lists; to be done again when a path has changed."""
    paths, first, following, numbers = table.paths, table.first, table.following, table.numbers
    first[:] = -1
    reach = _reach(p)
    for j in range(paths.shape[0] - 1):
        for m in range(numbers[COUNT, j]):
            row, column = _square(paths[j, m, CENTRE_Y], reach), _square(paths[j, m, CENTRE_X], reach)
            pose = j * POSES + m
            following[pose] = first[row, column]
            first[row, column] = pose


@inline
def _number_of(j, count, masks, numbers):
    """Return the number under which robot j is met: the next one, `count`, if it is new."""
    n = numbers[NUMBER, j]
    if n < count and numbers[WHO, n] == j:
        return n
    numbers[NUMBER, j], numbers[WHO, count] = count, j
    for k in range(masks.shape[2]):
        masks[TOUCH_WIDE, count, k] = masks[TOUCH_TIGHT, count, k] = masks[CROSS, count, k] = 0
    return count


@inline
def pose_in(pose, p):
    """Return the body, a Rectangle, at a pose of a path."""
    return body_at(pose[CENTRE_X], pose[CENTRE_Y], pose[COS], pose[SIN], p)


@inline
def _touch(table, row, k, j, m, count, p, q):
    """Write whether pose k of a path touches pose m of robot j's; return how many are met then.

    p, q: the parameters of whose path it is, and of robot j.
    """
    paths, masks, numbers = table.paths, table.masks, table.numbers
    one, other, reach = pose_in(paths[row, k], p), pose_in(paths[j, m], q), _reach(p)
    if squared_distance(one, other) > reach * reach:
        return count
    near = m == 0 or k == 0 or (k <= NEARBY and m <= NEARBY)
    room = TIGHT if near else WIDE
    if not rectangles_touch(grown(one, room), grown(other, room)):
        return count
    n, bit = _number_of(j, count, masks, numbers), BIT << np.uint32(m)
    masks[TOUCH_WIDE, n, k] |= bit
    if near or rectangles_touch(grown(one, TIGHT), grown(other, TIGHT)):
        masks[TOUCH_TIGHT, n, k] |= bit
    if one.c * other.c + one.s * other.s < ACROSS:
        masks[CROSS, n, k] |= bit
    return max(count, n + 1)


@part
def meet(i, row, last, table, p, kinds):
    """Find all robots whose paths touch a path of robot i's up to its pose number `last`; return how many.

    p: its own; kinds: see kinds.py.
    """
    paths, first, following = table.paths, table.first, table.following
    reach, count = _reach(p), whole(0)
    for k in range(last + 1):
        middle_row, middle_column = _square(paths[row, k, CENTRE_Y], reach), _square(paths[row, k, CENTRE_X], reach)
        for square in range(9):
            pose = first[
                (middle_row + square // 3 - 1) & (SQUARES - 1), (middle_column + square % 3 - 1) & (SQUARES - 1)
            ]
            while pose >= 0:
                j, m = pose >> PLACES, pose & (POSES - 1)
                if j != i:
                    count = _touch(table, row, k, j, m, count, p, kind_of(j, p, kinds))
                pose = following[pose]
    return count
