"""Where the paths ahead of robots meet: which pose of one touches which poses of another, as bits."""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, kernel
from warehouse_env.simulation.geometry import rectangles_touch
from warehouse_env.simulation.path_ahead import CENTRE_X, CENTRE_Y, COLUMNS, COS, POSES, SIN

WIDE = np.float32(0.08)  # [m] of room around bodies in what is granted anew: paths are predictions
TIGHT = np.float32(0.015)  # [m] around bodies that are near, and in what has been granted before
NEARBY = 2  # poses from where it is that are predicted well
ACROSS = np.float32(0.5)  # cosine of the angle from which one crosses another's path, rather than going along with it
PARTS, PART = 3, 10  # of a path with a box around each
_LEFT, _BOTTOM, _RIGHT, _TOP = range(4)
BIT = np.uint32(1)
TOUCH_WIDE, TOUCH_TIGHT, CROSS = range(3)  # of masks uint32[3, N, POSES]
COUNT, WHO, GRANT, MUST, ASKED = range(5)  # rows of numbers int32[5, N + 1]


@inline
def scratch(count, p):  # type: ignore[no-untyped-def]
    """Return the arrays of a world's decision, which the other functions call `ways`.

    paths float32[N + 1, POSES, COLUMNS]: the bodies ahead, the last row on trial; boxes float32[N + 1, PARTS, 4] around
    them; masks uint32[3, N, POSES]: of the n-th robot that a path meets, and for each pose of that path, a bit for each
    pose of the other that it touches with WIDE room, with TIGHT room, and across; numbers int32[5, N + 1]: poses of a
    path, the n-th robot met, poses granted, poses in which a robot can stop, and whether it has been asked.
    """
    if p["right_of_way"] == 0:
        count = 0
    paths = np.empty((count + 1, POSES, COLUMNS), np.float32)
    boxes = np.empty((count + 1, PARTS, 4), np.float32)
    masks = np.empty((3, count, POSES), np.uint32)
    numbers = np.empty((5, count + 1), np.int32)
    return paths, boxes, masks, numbers


@inline
def bound(row, ways):  # type: ignore[no-untyped-def]
    """Put boxes around the parts of a path's body centres."""
    paths, boxes, _, numbers = ways
    for part in range(PARTS):
        left = bottom = np.float32(np.inf)
        right = top = np.float32(-np.inf)
        for k in range(part * PART, min(part * PART + PART, numbers[COUNT, row])):
            x, y = paths[row, k, CENTRE_X], paths[row, k, CENTRE_Y]
            left, right, bottom, top = min(left, x), max(right, x), min(bottom, y), max(top, y)
        boxes[row, part, _LEFT], boxes[row, part, _RIGHT] = left, right
        boxes[row, part, _BOTTOM], boxes[row, part, _TOP] = bottom, top


@inline
def _apart(boxes, row, a, j, b, reach):  # type: ignore[no-untyped-def]
    """Whether parts a and b of two paths are farther from each other than `reach` [m]."""
    return (
        boxes[row, a, _LEFT] > boxes[j, b, _RIGHT] + reach
        or boxes[j, b, _LEFT] > boxes[row, a, _RIGHT] + reach
        or boxes[row, a, _BOTTOM] > boxes[j, b, _TOP] + reach
        or boxes[j, b, _BOTTOM] > boxes[row, a, _TOP] + reach
    )


@kernel
def _touch(ways, row, j, a, b, n, p):  # type: ignore[no-untyped-def]
    """Write which poses of part a of a path touch part b of robot j's, as the n-th it meets; return whether any do."""
    paths, _, masks, numbers = ways
    length, width, found = p["half_length"], p["half_width"], False
    reach = p["radius"] + p["radius"] + WIDE + WIDE + WIDE
    last = min(b * PART + PART, numbers[COUNT, j])
    for k in range(a * PART, min(a * PART + PART, numbers[COUNT, row])):
        x, y, c, s = paths[row, k, CENTRE_X], paths[row, k, CENTRE_Y], paths[row, k, COS], paths[row, k, SIN]
        for m in range(b * PART, last):
            dx, dy = paths[j, m, CENTRE_X] - x, paths[j, m, CENTRE_Y] - y
            if dx * dx + dy * dy > reach * reach:
                continue
            other_c, other_s = paths[j, m, COS], paths[j, m, SIN]
            near = m == 0 or k == 0 or (k <= NEARBY and m <= NEARBY)
            room = TIGHT if near else WIDE
            if not rectangles_touch(
                dx, dy, c, s, length + room, width + room, other_c, other_s, length + room, width + room
            ):
                continue
            found = True
            bit = BIT << np.uint32(m)
            masks[TOUCH_WIDE, n, k] |= bit
            if near or rectangles_touch(
                dx, dy, c, s, length + TIGHT, width + TIGHT, other_c, other_s, length + TIGHT, width + TIGHT
            ):
                masks[TOUCH_TIGHT, n, k] |= bit
            if c * other_c + s * other_s < ACROSS:
                masks[CROSS, n, k] |= bit
    return found


@kernel
def meet(i, row, ways, p):  # type: ignore[no-untyped-def]
    """Find all robots whose paths touch a path of robot i's; return how many."""
    paths, boxes, masks, numbers = ways
    reach, count = p["radius"] + p["radius"] + WIDE + WIDE + WIDE, 0
    for j in range(paths.shape[0] - 1):
        if j == i:
            continue
        found = False
        for a in range(PARTS):
            for b in range(PARTS):
                if a * PART >= numbers[COUNT, row] or b * PART >= numbers[COUNT, j]:
                    continue
                if _apart(boxes, row, a, j, b, reach):
                    continue
                if not found:
                    for k in range(POSES):
                        masks[TOUCH_WIDE, count, k] = masks[TOUCH_TIGHT, count, k] = masks[CROSS, count, k] = 0
                found = _touch(ways, row, j, a, b, count, p) or found
        if found:
            numbers[WHO, count] = j
            count += 1
    return count
