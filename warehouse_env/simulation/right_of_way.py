"""Right of way: once a decision, each robot is granted a stretch of the path ahead of it, and drives no farther.

Robots are asked one after another, who has been longest on its way first; who bars the way of another has that one's
right (priority inheritance, as in PIBT, Okumura et al. 2022). A robot is granted its path up to the first pose that
touches what another has been granted, as AGVs reserve zones ahead of them. The end of a grant is a place to wait at, so

- it is never where one would soon cross the robot (do not stop on a crossing, nor in a lane that others come along);
- who waits for another does so off all of that one's path, so no two wait for each other;
- what has been granted is kept, unless another could not stop before it any more.

If what bars the way stands or comes the other way, the robot's other lateral offsets are tried, the commanded one
first. What robots would have to tell each other for it, within 16 m: the poses ahead (path_ahead.py), how far they have
been granted them, how long they have been on their way, whom they wait for, and whether they make room.

Where all wait in a ring none the less, one of them makes room: making_room.py. Under it all lies the field (field.py):
paths are predictions, and whatever is granted, no robot moves where it could not stop clear of all others.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.simulation.geometry import rectangles_touch
from warehouse_env.simulation.kernel import inline, kernel
from warehouse_env.simulation.path_ahead import APART, CENTRE_X, CENTRE_Y, COS, POSES, SIN, write_path
from warehouse_env.simulation.trigonometry import HALF, ZERO

NOBODY = -1
AHEAD = 6  # poses asked for beyond those in which it can stop: 3 m
SOON = 6  # poses beyond its grant within which one counts as soon to come
WIDE = np.float32(0.08)  # [m] of room around bodies in what is granted anew: paths are predictions
TIGHT = np.float32(0.015)  # [m] around bodies that are near, and in what has been granted before
NEARBY = 2  # poses from where it is that are predicted well
ACROSS = np.float32(0.5)  # cosine of the angle from which one crosses another's path, rather than going along with it
AGAINST = np.float32(-0.5)  # ... and from which it comes the other way
BACK = 4  # poses more that must be free to go back to the commanded offset
REFUSED = np.float32(0.8)  # [s] that the field has held a robot from which it waits for who held it
SLOW = np.float32(0.1)  # [m/s]
PARTS, PART = 3, 10  # of a path with a box around each
_LEFT, _BOTTOM, _RIGHT, _TOP = range(4)
_BIT = np.uint32(1)


@inline
def scratch(count, p):  # type: ignore[no-untyped-def]
    """Return the arrays of a world's decision.

    paths float32[N + 1, POSES, 4]: the bodies ahead, the last row on trial; boxes float32[N + 1, PARTS, 4] around them;
    poses int32[N + 1]: how many; at_end bool[N + 1]: is the goal among them. who int32[N], wide, tight, across
    uint32[N, POSES]: those that a path meets, and for each of its poses a bit for each of theirs that it touches.
    grants, musts, asked int32[N]: poses granted, those in which it can stop; has it been asked. order int32[N].
    """
    if p["right_of_way"] == 0:
        count = 0
    paths = np.empty((count + 1, POSES, 4), np.float32)
    boxes = np.empty((count + 1, PARTS, 4), np.float32)
    masks = np.empty((3, count, POSES), np.uint32)
    numbers = np.empty((5, count + 1), np.int32)
    return paths, boxes, masks, numbers


PATHS, BOXES, MASKS, NUMBERS = range(4)
TOUCH_WIDE, TOUCH_TIGHT, CROSS = range(3)  # of masks
COUNT, WHO, GRANT, MUST, ASKED = range(5)  # rows of numbers


@inline
def _bound(row, ways):  # type: ignore[no-untyped-def]
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
    """Write which poses of part a of a path touch part b of robot j's, the n-th that it meets; return whether any do."""
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
            bit = _BIT << np.uint32(m)
            masks[TOUCH_WIDE, n, k] |= bit
            if near or rectangles_touch(
                dx, dy, c, s, length + TIGHT, width + TIGHT, other_c, other_s, length + TIGHT, width + TIGHT
            ):
                masks[TOUCH_TIGHT, n, k] |= bit
            if c * other_c + s * other_s < ACROSS:
                masks[CROSS, n, k] |= bit
    return found


@kernel
def _meet(i, row, ways, p):  # type: ignore[no-untyped-def]
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


@inline
def _first(k):  # type: ignore[no-untyped-def]
    """Return the bits of poses 0 to k."""
    return np.uint32(0xFFFFFFFF) if k >= 31 else np.uint32((_BIT << np.uint32(k + 1)) - _BIT)


@inline
def _reach_of_grants(row, count, have, ways):  # type: ignore[no-untyped-def]
    """Return (the last pose before what others have been granted, who bars the way there or NOBODY)."""
    _, _, masks, numbers = ways
    last, barrier = numbers[COUNT, row] - 1, NOBODY
    for n in range(count):
        j = numbers[WHO, n]
        granted = _first(numbers[GRANT, j])
        firm = granted if numbers[ASKED, j] != 0 else _first(numbers[MUST, j])
        for k in range(1, last + 1):
            if masks[TOUCH_WIDE, n, k] & granted and (k > have or masks[TOUCH_TIGHT, n, k] & firm):
                last, barrier = k - 1, j
                break
    return last, barrier


@inline
def _may_wait(k, count, barrier, ways):  # type: ignore[no-untyped-def]
    """Return whose path a robot that waits at pose k would bar, NOBODY if it may wait there."""
    _, _, masks, numbers = ways
    for n in range(count):
        j = numbers[WHO, n]
        bars = masks[CROSS, n, k] & _first(numbers[GRANT, j] + SOON)
        if j == barrier:
            bars = masks[TOUCH_WIDE, n, k]
        if bars & ~_first(numbers[GRANT, j]):
            return j
    return NOBODY


@kernel
def _grant(row, count, have, must, want, yields, ways):  # type: ignore[no-untyped-def]
    """Return (poses granted of a path, who bars the way to `want` or NOBODY); yields: it may wait anywhere."""
    last, barrier = _reach_of_grants(row, count, have, ways)
    k = min(max(min(have, last), must), last)
    best, barred_by = NOBODY, NOBODY
    least = k
    while k <= last:
        bars = NOBODY if yields else _may_wait(k, count, barrier if last < want else NOBODY, ways)
        if bars == NOBODY:
            best = k
            if k >= want:
                break
        else:
            barred_by = bars
        k += 1
    granted = best if best != NOBODY else least
    if granted >= want:
        return granted, NOBODY
    return granted, barrier if barrier != NOBODY else barred_by


@inline
def _comes_against(row, granted, count, barrier, ways):  # type: ignore[no-untyped-def]
    """Whether who bars the way comes the other way where the paths first touch beyond the grant."""
    paths, _, masks, numbers = ways
    for n in range(count):
        if numbers[WHO, n] != barrier:
            continue
        for k in range(granted, numbers[COUNT, row]):
            for m in range(numbers[COUNT, barrier]):
                if masks[TOUCH_WIDE, n, k] >> np.uint32(m) & _BIT:
                    return (
                        paths[row, k, COS] * paths[barrier, m, COS] + paths[row, k, SIN] * paths[barrier, m, SIN]
                        < AGAINST
                    )
    return False


@kernel
def _try_sides(i, r, route, arcs, wanted, sides, granted, barrier, ways, p, clearance):  # type: ignore[no-untyped-def]
    """Try the robot's other offsets, the commanded one first, for one whose path is free as far as it asks.

    Takes the first that is, and returns the new (poses granted, who bars the way).
    """
    paths, boxes, _, numbers = ways
    trial = paths.shape[0] - 1
    for n in range(-1, sides.shape[0]):
        side = wanted if n < 0 else sides[n]
        if side == r["side"]:
            if barrier == NOBODY:
                break  # the best that is free is the one it has
            continue
        if n >= 0 and side == wanted:
            continue
        numbers[COUNT, trial], at_end = write_path(r, route, arcs, side, p, clearance, paths[trial])
        _bound(trial, ways)
        want = min(numbers[MUST, i] + AHEAD + (BACK if side == wanted else 0), numbers[COUNT, trial] - 1)
        if want < 2:
            continue
        count = _meet(i, trial, ways, p)
        free, _ = _grant(trial, count, 0, numbers[MUST, i], want, False, ways)
        if free >= want:
            r["side"], r["at_end"] = side, at_end
            paths[i] = paths[trial]
            boxes[i] = boxes[trial]
            numbers[COUNT, i] = numbers[COUNT, trial]
            return free, NOBODY
    return granted, barrier


@inline
def _begin(i, r, route, arcs, ways, p, clearance):  # type: ignore[no-untyped-def]
    """Write the robot's path and what it has been granted of it before."""
    paths, _, _, numbers = ways
    if r["arcs"] == 0:
        r["aside"] = 0
    numbers[COUNT, i], r["at_end"] = write_path(r, route, arcs, r["side"], p, clearance, paths[i])
    _bound(i, ways)
    here, speed, apart = np.floor(r["distance"] / np.float64(APART)), abs(r["speed"]), np.float64(APART)
    have = max(int(np.round(r["claim"] / apart) - here), 0)
    stop = speed * speed * HALF / p["max_acceleration"] + speed * p["time_step"] * np.float32(p["repeat"])
    must = ZERO if speed < SLOW else np.ceil((r["distance"] + stop) / apart - 1e-3) - here
    must = min(int(must), have) if r["claim"] > 0.0 else int(must)
    last = numbers[COUNT, i] - 1
    numbers[MUST, i], numbers[GRANT, i], numbers[ASKED, i] = min(must, last), min(max(must, have), last), 0


@inline
def _ask(i, robots, route, arcs, wanted, sides, ways, p, clearance):  # type: ignore[no-untyped-def]
    """Grant robot i what it may have of its path."""
    _, _, _, numbers = ways
    r = robots[i]
    numbers[ASKED, i] = 1
    r["yields_to"] = NOBODY
    if r["alive"] == 0:
        return
    must = numbers[MUST, i]
    want = min(must + AHEAD, numbers[COUNT, i] - 1)
    count = _meet(i, i, ways, p)
    granted, barrier = _grant(i, count, numbers[GRANT, i], must, want, r["aside"] != 0, ways)
    if r["arcs"] == 0:
        stuck = barrier != NOBODY and (
            abs(robots[barrier]["speed"]) < SLOW or _comes_against(i, granted, count, barrier, ways)
        )
        if stuck or r["side"] != wanted:
            granted, barrier = _try_sides(i, r, route, arcs, wanted, sides, granted, barrier, ways, p, clearance)
    numbers[GRANT, i] = granted
    r["claim"] = (np.floor(r["distance"] / np.float64(APART)) + granted) * np.float64(APART)
    if barrier == NOBODY and r["held_by"] >= 0 and r["held_time"] > REFUSED and abs(r["speed"]) < SLOW:
        barrier = r["held_by"]
    r["yields_to"] = barrier
    r["authority"] = np.float32(max(r["claim"] - r["distance"], 0.0))
    if r["at_end"] != 0 and granted == numbers[COUNT, i] - 1:
        r["authority"] = np.float32(np.inf)  # the goal: it need not stop there


@inline
def rank(robots, order):  # type: ignore[no-untyped-def]
    """Write the robots in the order of their right: longest on the way to its goal first, and with it who bars it."""
    count = robots.shape[0]
    for i in range(count):
        robots[i]["right"] = robots[i]["age"]
    for i in range(count):
        j, steps = robots[i]["yields_to"], 0
        while j != NOBODY and steps < count and robots[j]["right"] < robots[i]["age"]:
            robots[j]["right"] = robots[i]["age"]
            j = robots[j]["yields_to"]
            steps += 1
    for i in range(count):
        k = i
        while k > 0 and robots[order[k - 1]]["right"] < robots[i]["right"]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = i


@kernel
def decide(robots, routes, arcs, commands, sides, order, ways, p, clearance):  # type: ignore[no-untyped-def]
    """Grant all robots of a world a stretch of their paths: `authority` [m], `side` [m] and `yields_to` of the records.

    commands float32[N, 2]: speed [m/s] and lateral offset [m] of each; sides float32[O]: the offsets that may be tried
    instead, in this order; order int32[N]: robots as `rank` has sorted them; ways: see `scratch`.
    """
    count = robots.shape[0]
    for i in range(count):
        _begin(i, robots[i], routes[i], arcs[i], ways, p, clearance)
    for n in range(count):
        i = order[n]
        _ask(i, robots, routes[i], arcs[i], commands[i, 1], sides, ways, p, clearance)


@inline
def limit(r, speed, p):  # type: ignore[no-untyped-def]
    """Return a commanded speed [m/s], or the fastest below it from which the robot stops within its authority."""
    if r["authority"] == np.float32(np.inf):
        return speed
    brake = p["max_acceleration"]
    lag = brake * p["time_step"] * np.float32(p["repeat"])
    return min(speed, max(np.sqrt(lag * lag + np.float32(2.0) * brake * r["authority"]) - lag, ZERO))
