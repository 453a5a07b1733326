"""Right of way: in each decision, every robot is granted a stretch of its path, and drives no farther.

Robots are asked in turn, the one that has been on its way longest first. A robot that blocks another inherits its right
(priority inheritance, as in PIBT, Okumura et al. 2022). A robot is granted its path up to the first pose that touches a
stretch granted to another, as AGVs reserve zones ahead. The end of a grant must be a place to wait:

- It is never where another robot would soon cross (no stop on a crossing, nor in a lane that others come along).
- A robot waits off the whole path of the robot that it waits for, so no two wait for each other.
- A grant is kept, unless another robot cannot stop before it any more.
- It is never beside a person, nor where one will be a second later. So a robot that waits for people blocks nobody. Two
  robots that keep a person from walking wait for each other, and a single one waits for itself (waits.py).

If the blocking robot stands or comes the other way, the robot tries its other lateral offsets, in the order of its
preferences. Robots within 16 m exchange their paths ahead (path_ahead.py), grants, time on the way, whom they wait for,
and whether they retreat.

Wait cycles that remain are resolved by deadlock_recovery.py. Right of way may apply only near robots that have stood
for a while (local_activation.py). The shield stays in force below it (shield.py): paths are predictions, and no grant
lets a robot move where it could not stop clear of all others.
"""

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import inline, part, whole
from warehouse_env.simulation.driver.line import forget_path
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.trigonometry import HALF, ZERO
from warehouse_env.simulation.senses.preferences import SIDE, speed_of
from warehouse_env.simulation.state import NOBODY
from warehouse_env.simulation.traffic.path_ahead import (
    COS,
    DRIVEN,
    POSES,
    SIN,
    before_people,
    begin_path,
    keep_path,
    write_path,
)  # fmt: skip
from warehouse_env.simulation.traffic.reservations import (
    ASKED,
    BIT,
    COUNT,
    CROSS,
    GRANT,
    MUST,
    TOUCH_TIGHT,
    TOUCH_WIDE,
    WHO,
    enlist,
    meet,
)  # fmt: skip
from warehouse_env.simulation.traffic.waits import SLOW, is_kept, is_urged, refuser, yields_for

AHEAD = 2  # poses requested beyond the stopping distance: 1 m; more would block others for longer
BESIDE = 6  # poses that must be free beyond these at another offset
MORE = 6  # poses beyond these that it takes if it may not wait there
SOON = 6  # poses beyond its grant within which one counts as soon to come
AGAINST = np.float32(-0.5)  # ... and from which it comes the other way
BACK = 4  # poses more that must be free to go back to the commanded offset
TRIED = 5  # decisions after which a robot tries other offsets again while the same one bars its way
NOWHERE = -1  # no pose
_ROUNDING = np.float32(1e-3)  # [m] of an odometer


class Claims(NamedTuple):
    """A world whose robots ask for stretches of their paths."""

    robots: Any  # ROBOT[N]
    persons: Any  # PERSON[M]
    routes: Any  # float32[N, R, 2] [m]
    arcs: Any  # float32[N, ARCS, 2], manoeuvres
    commands: Any  # float32[N, 2]: speed [m/s], which becomes the one liked with the offset taken, and offset [m]
    choices: Any  # float32[N, K, 3], see preferences.py
    table: Any  # ReservationTable


@inline
def _first(k):
    """Return the bits of poses 0 to k."""
    return np.uint32(0xFFFFFFFF) if k >= 31 else np.uint32((BIT << np.uint32(k + 1)) - BIT)


@inline
def _reach_of_grants(count, have, end, table):
    """Return (the last pose up to `end` before the grants of others, the robot that blocks it or NOBODY)."""
    masks, numbers = table.masks, table.numbers
    last, barrier = end, NOBODY
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
def _may_wait(k, count, barrier, table):
    """Return the robot whose path a robot would block by waiting at pose k, or NOBODY."""
    masks, numbers = table.masks, table.numbers
    for n in range(count):
        j = numbers[WHO, n]
        bars = masks[CROSS, n, k] & _first(numbers[GRANT, j] + SOON)
        if j == barrier:
            bars = masks[TOUCH_WIDE, n, k]
        if bars & ~_first(numbers[GRANT, j]):
            return j
    return NOBODY


@part
def _grant(count, have, must, want, end, goal, yields, table):
    """Return (poses granted of a path, the robot that blocks the way to `want`, or NOBODY). yields: may wait anywhere.

    The grant is longer than wanted, up to pose `end`, if the robot may not wait sooner; it does not wait at `goal`.
    """
    last, barrier = _reach_of_grants(count, have, end, table)
    k = min(max(min(have, last), must), last)
    best, barred_by = NOBODY, NOBODY
    least = k
    while k <= last:
        bars = NOBODY if yields or k == goal else _may_wait(k, count, barrier if last < want else NOBODY, table)
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
def _comes_against(row, granted, end, count, barrier, table):
    """Whether the blocking robot comes the other way where the paths first touch beyond the grant."""
    paths, masks, numbers = table.paths, table.masks, table.numbers
    for n in range(count):
        if numbers[WHO, n] != barrier:
            continue
        for k in range(granted, end + 1):
            for m in range(numbers[COUNT, barrier]):
                if masks[TOUCH_WIDE, n, k] >> np.uint32(m) & BIT:
                    return (
                        paths[row, k, COS] * paths[barrier, m, COS] + paths[row, k, SIN] * paths[barrier, m, SIN]
                        < AGAINST
                    )
    return False


@inline
def _write(i, world, p, floor):
    """Write a robot's path anew."""
    r, paths, numbers = world.robots[i], world.table.paths, world.table.numbers
    poses, at_end = write_path(
        r, world.routes[i], world.arcs[i], r["traffic"]["side"], whole(POSES), p, floor, paths[i]
    )
    begin_path(r, poses, at_end)
    numbers[COUNT, i] = poses


@part
def _try_sides(i, world, granted, barrier, p, kinds, floor):
    """Try the robot's other offsets, the preferred one first, until a path is free as far as requested.

    Takes it, and returns the new (poses granted, robot that blocks the way).
    """
    r, table, choices = world.robots[i], world.table, world.choices[i]
    paths, numbers = table.paths, table.numbers
    trial, wanted = paths.shape[0] - 1, choices[0, SIDE]
    for n in range(choices.shape[0]):
        side = choices[n, SIDE]
        if side == r["traffic"]["side"]:
            if barrier == NOBODY:
                break  # the best that is free is the one it has
            continue
        if n > 0 and side == wanted:
            continue
        want = numbers[MUST, i] + BESIDE + (BACK if side == wanted else 0)
        many, at_end = write_path(r, world.routes[i], world.arcs[i], side, min(want + 1, POSES), p, floor, paths[trial])
        numbers[COUNT, trial], want = many, min(want, many - 1)
        if want < 2:
            continue
        count = meet(i, trial, want, table, p, kinds)
        goal = many - 1 if at_end else NOWHERE
        # want < 0: False, but for Numba no constant (kernel.py)
        free, _ = _grant(count, whole(0), numbers[MUST, i], want, want, goal, want < 0, table)
        if free >= want:
            r["traffic"]["side"] = side
            _write(i, world, p, floor)
            enlist(table, p)
            return free, NOBODY
    return granted, barrier


@inline
def _within(path, count, way):
    """Return the last pose of a path that is at most `way` [m] of driving ahead."""
    k = 0
    while k + 1 < count and path[k + 1, DRIVEN] <= way:
        k += 1
    return k


@inline
def _begin(i, world, p, floor):
    """Bring the robot's path up to date, and what it has been granted of it before."""
    r, paths, numbers = world.robots[i], world.table.paths, world.table.numbers
    traffic = r["traffic"]
    if r["manoeuvre"]["arcs"] == 0 and traffic["retreating"] != 0:
        traffic["retreating"] = 0
        forget_path(r)
    if keep_path(r, paths[i], p):
        numbers[COUNT, i] = traffic["poses"]
    else:
        _write(i, world, p, floor)
    speed, last = abs(r["motion"]["speed"]), numbers[COUNT, i] - 1
    have = _within(paths[i], last + 1, np.float32(traffic["claim"] - r["totals"]["distance"]) + _ROUNDING)
    stop = speed * speed * HALF / p["max_acceleration"] + speed * p["time_step"] * np.float32(p["repeat"])
    must = 0 if speed < SLOW else _within(paths[i], last + 1, stop - _ROUNDING) + 1
    must = min(must, have) if traffic["claim"] > 0.0 else must
    numbers[MUST, i], numbers[GRANT, i], numbers[ASKED, i] = min(must, last), min(max(must, have), last), 0


@inline
def _ask(i, world, p, kinds, floor):
    """Grant robot i a stretch of its path; p: its own."""
    robots, persons, table = world.robots, world.persons, world.table
    paths, numbers = table.paths, table.numbers
    r = robots[i]
    traffic = r["traffic"]
    numbers[ASKED, i] = 1 - r["shield"]["silent"]
    before, traffic["yields_to"] = traffic["yields_to"], NOBODY
    if r["task"]["alive"] == 0:
        return
    must = numbers[MUST, i]
    want = min(must + AHEAD, numbers[COUNT, i] - 1)
    end = min(want + MORE, numbers[COUNT, i] - 1)
    count = meet(i, i, end, table, p, kinds)
    goal = numbers[COUNT, i] - 1 if traffic["at_end"] != 0 else NOWHERE
    granted, barrier = _grant(count, whole(numbers[GRANT, i]), must, want, end, goal, traffic["retreating"] != 0, table)
    if r["manoeuvre"]["arcs"] == 0 and traffic["rules_active"] > ZERO:
        stuck = barrier != NOBODY and (
            abs(robots[barrier]["motion"]["speed"]) < SLOW or _comes_against(i, granted, end, count, barrier, table)
        )
        again = barrier != before or (r["task"]["age"] // p["repeat"] + i) % TRIED == 0
        if (stuck and again) or (barrier == NOBODY and traffic["side"] != world.choices[i, 0, SIDE]):
            granted, barrier = _try_sides(i, world, granted, barrier, p, kinds, floor)
    granted, person = before_people(paths[i], must, granted, persons, p)
    if person != NOBODY and is_kept(persons[person]):
        barrier = yields_for(i, persons[person], robots, p, kinds)
    if r["shield"]["silent"] == 0:
        numbers[GRANT, i] = granted
    traffic["authority"] = paths[i, granted, DRIVEN]
    traffic["claim"] = r["totals"]["distance"] + np.float64(traffic["authority"])
    traffic["yields_to"] = refuser(r) if barrier == NOBODY else barrier
    if traffic["at_end"] != 0 and granted == numbers[COUNT, i] - 1:
        traffic["authority"] = np.float32(np.inf)  # the goal: it need not stop there


@inline
def _goes_first(robots, i, j):
    """Whether robot i has the right before robot j."""
    one, other = robots[i]["traffic"]["right"], robots[j]["traffic"]["right"]
    return one > other or (one == other and i < j)


@inline
def _sort(robots, order):
    """Sort robots by their right (Shell 1959 with Knuth's gaps): short code, and far from quadratic for thousands."""
    gap = 1
    while 3 * gap + 1 < len(order):
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, len(order)):
            one, k = order[i], i
            while k >= gap and _goes_first(robots, one, order[k - gap]):
                order[k] = order[k - gap]
                k -= gap
            order[k] = one
        gap //= 3


@inline
def rank(robots, order):
    """Write the robots in the order of their right: the longest on its way first, with the robots that block it.

    order int[N]: their indices; of equals the lower first.
    """
    count = robots.shape[0]
    for i in range(count):
        robots[i]["traffic"]["right"] = robots[i]["task"]["age"]
    for i in range(count):
        j, steps = robots[i]["traffic"]["yields_to"], 0
        while j != NOBODY and steps < count and robots[j]["traffic"]["right"] < robots[i]["task"]["age"]:
            robots[j]["traffic"]["right"] = robots[i]["task"]["age"]
            j = robots[j]["traffic"]["yields_to"]
            steps += 1
        order[i] = i
    _sort(robots, order)


@part
def decide(world, order, p, kinds, floor):
    """Grant all robots of a world, Claims, a stretch of their paths: `authority` [m], `side` [m] and `yields_to` of the
    records. order int[N]: robots as `rank` has sorted them; kinds: see kinds.py.
    """
    robots, commands = world.robots, world.commands
    for i in range(robots.shape[0]):
        _begin(i, world, kind_of(i, p, kinds), floor)
    enlist(world.table, p)
    for n in range(robots.shape[0]):
        i = whole(order[n])
        _ask(i, world, kind_of(i, p, kinds), kinds, floor)
        if robots[i]["traffic"]["rules_active"] > ZERO:
            commands[i, 0] = speed_of(robots[i], world.choices[i], commands[i, 0], is_urged(robots[i]))


@inline
def limit(r, speed, p):
    """Return a commanded speed [m/s], or the fastest below it from which the robot stops within its authority.

    A manoeuvre is driven whatever the command: a policy that stands or backs would undo the way out of a jam.
    """
    if r["manoeuvre"]["arcs"] > 0:
        speed = p["max_speed"]
    if r["traffic"]["authority"] == np.float32(np.inf):
        return speed
    brake = p["max_acceleration"]
    lag = brake * p["time_step"] * np.float32(p["repeat"])
    return min(speed, max(np.sqrt(lag * lag + np.float32(2.0) * brake * r["traffic"]["authority"]) - lag, ZERO))
