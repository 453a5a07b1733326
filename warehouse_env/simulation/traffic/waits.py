"""The wait-for graph: which robot waits for which, and after how long recovery acts.

`waits_for` names the robot that a standing robot waits for, `find_wait_cycles` finds the cycles of that graph, and
`look` gives each robot of a world a stage:

- MOVES: it has driven within the last second, retreats, or is parked;
- WAITS: it stands, and nothing is done about it yet;
- SEEKS: it is in a wait cycle in which all stand, and has waited so long that one of them must leave the cycle;
- STUCK: it has long waited for a permanently standing robot, and goes around it.

The table below holds all times; docs/traffic.md lists them in order. Each robot has four clocks, in simulated seconds:
`waiting_time` without driving, `standing_time` within a metre of one place (it may rock there), `stalled_time` without
a metre of progress along its route, and `contact_time` in touch. The shield adds `vetoed_time`, for which it has
refused the robot's commands without a break.

Nobody passes a robot in an aisle of one cell, and no robot moves beside a person. So two robots that shut a person in
wait for each other, a wait cycle that recovery resolves (deadlock_recovery.py). A single robot waits for itself, as
both do if the cycle persists: it leaves its place.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, kernel, part
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.people import gap_to
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO
from warehouse_env.simulation.state import NOBODY
from warehouse_env.simulation.traffic.in_the_way import first_in_the_way

SLOW = np.float32(0.1)  # [m/s] under which a robot counts as not driving
KEEPS = np.float32(1.5)  # [m] within which robots keep a person from walking

# Thresholds in seconds, each with its clock.
REFUSED = np.float32(0.8)  # vetoed: the robot yields to the one that vetoed it
STANDS = np.float32(0.95)  # waiting: it stands (1 s less rounding); standing: it has halted
KEPT = np.float32(1.5)  # kept, a person's clock: robots count as keeping the person from walking
URGED = np.float32(2.0)  # standing: with right of way it goes, even if its policy would stand
SEEKS_AFTER = np.float32(2.0)  # waiting, in a wait cycle: one of its robots leaves
PERMANENT = np.float32(2.0)  # waiting: it counts as permanently standing
LONG_KEPT = np.float32(3.0)  # kept: each robot that keeps the person makes room
STUCK_AFTER = np.float32(4.0)  # waiting for a permanently standing robot: it goes around that robot
SHUT_IN_AFTER = np.float32(20.0)  # waiting: its search has no range limit, and the queue behind clears its path
ROCKS = np.float32(4.95)  # standing: it stands, even if it rocks (5 s less rounding)
LONGER = np.float32(5.0)  # standing, times `right_of_way_after`: rules act around it, even outside a wait cycle
DEARER = 20.0  # standing: standing robots cost its route twice as much, after 40 s three times, and so on

# Durations in seconds.
PAUSE = np.float32(3.0)  # between a failed search and the next
LEAVES = np.float32(5.0)  # for which a robot counts as retreating
CALM = np.float32(10.0)  # for which rules stay active after the last call nearby

MOVES, WAITS, SEEKS, STUCK = range(4)  # stages
WHO, CYCLE, STAGE, SPARE = range(4)  # rows of int64[4, N]: waits for whom, lowest robot of its cycle, stage
_UNASKED = -2


def scratch(count: int) -> NDArray[np.int64]:
    """Return the array `found` that the other functions write for a world."""
    return np.empty((4, count), np.int64)


@inline
def count_time(r, dt):
    """Advance a robot's clocks by a physics step of `dt` [s], except for the shield's."""
    motion, totals, clocks = r["motion"], r["totals"], r["clocks"]
    if r["on_route"]["position"] > clocks["milestone"] + ONE:
        clocks["milestone"] = r["on_route"]["position"]
        clocks["stalled_time"] = ZERO
    else:
        clocks["stalled_time"] += dt
    dx, dy = motion["x"] - clocks["anchor_x"], motion["y"] - clocks["anchor_y"]
    if dx * dx + dy * dy > ONE:
        clocks["anchor_x"], clocks["anchor_y"] = motion["x"], motion["y"]
        clocks["standing_time"] = ZERO
    else:
        clocks["standing_time"] += dt
        totals["longest_standing"] = max(totals["longest_standing"], clocks["standing_time"])
    if abs(motion["speed"]) < SLOW:
        totals["waited"] += 1
        clocks["waiting_time"] += dt
    else:
        clocks["waiting_time"] = ZERO
    clocks["contact_time"] = clocks["contact_time"] + dt if r["events"]["touching"] != 0 else ZERO


@inline
def gets_nowhere(r):
    """Whether a robot that is not parked stands, or rocks where it is."""
    return r["task"]["alive"] != 0 and (r["clocks"]["waiting_time"] >= STANDS or r["clocks"]["standing_time"] >= ROCKS)


@inline
def has_halted(r):
    """Whether a robot that is not parked has halted: its speed is zero, and it has not moved a metre for a while."""
    return r["task"]["alive"] != 0 and r["motion"]["speed"] == ZERO and r["clocks"]["standing_time"] >= STANDS


@inline
def stands_permanently(r):
    """Whether a robot counts as permanently standing: it has stood for a while, or is parked."""
    return r["task"]["alive"] == 0 or r["clocks"]["waiting_time"] > PERMANENT


@inline
def bars_routes(r, stood_for):
    """Whether routes lead around a robot: it has not moved a metre for `stood_for` [s], or is parked."""
    return r["task"]["alive"] == 0 or r["clocks"]["standing_time"] >= stood_for


@inline
def is_urged(r):
    """Whether a robot with right of way drives even if its policy would stand."""
    return r["traffic"]["authority"] > ZERO and r["clocks"]["standing_time"] >= URGED


@inline
def refuser(r):
    """Return the robot to which a standing robot yields after a long veto, or NOBODY."""
    refused = r["shield"]["vetoed_time"] > REFUSED and abs(r["motion"]["speed"]) < SLOW
    return r["shield"]["vetoed_by"] if refused else NOBODY


@inline
def may_leave(r):
    """Whether a standing robot can be asked to leave: it is not parked, and not retreating already."""
    return (
        r["task"]["alive"] != 0
        and r["clocks"]["waiting_time"] >= STANDS
        and (r["traffic"]["retreating"] == 0 or r["traffic"]["pause"] <= ZERO)
    )


@inline
def is_shut_in(r):
    """Whether a robot has waited so long that its recovery search has no range limit."""
    return r["clocks"]["waiting_time"] > SHUT_IN_AFTER


@inline
def _may_search(r):
    """Whether a robot may search a manoeuvre: it keeps to its grant, yields, and has not just searched."""
    traffic = r["traffic"]
    return traffic["rules_active"] > ZERO and traffic["yields_to"] != NOBODY and traffic["pause"] <= ZERO


@inline
def is_kept(o):
    """Whether robots have kept a person from walking for a while."""
    return o["kept"] > KEPT


@inline
def yields_for(i, o, robots, p, kinds):
    """Return the robot that robot i waits for beside a kept person: the nearest other one that keeps it, or itself."""
    nearest, least = i, KEEPS
    for j in range(robots.shape[0]):
        gap = gap_to(o["x"], o["y"], robots[j], kind_of(j, p, kinds))
        if j != i and gap < least:
            nearest, least = j, gap
    return i if o["kept"] > LONG_KEPT else nearest


@part
def waits_for(robots, i, route, p, kinds, near):
    """Return the robot that robot i of ROBOT[N] waits for, or NOBODY.

    That is the robot named by the shield or by right of way, otherwise the first body in its way. route: its own,
    float32[R, 2] [m]; near: int[N], scratch; kinds: see kinds.py.
    """
    r = robots[i]
    traffic = r["traffic"]
    if not gets_nowhere(r):
        return NOBODY
    if r["shield"]["vetoed_by"] != NOBODY:
        return r["shield"]["vetoed_by"]
    if traffic["yields_to"] != NOBODY and traffic["yields_to"] != i:  # itself: it is to let a person out
        return traffic["yields_to"]
    return first_in_the_way(robots, i, route, kind_of(i, p, kinds), kinds, near)


@part
def find_wait_cycles(who, cycle, walk):
    """Write into cycle int[N] the lowest robot of the wait cycle of each robot, NOBODY for those in none.

    who int[N]: the robot that each waits for, or NOBODY; walk int[N]: scratch, the walk that first met each robot.
    """
    cycle[:] = NOBODY
    walk[:] = NOBODY
    for i in range(who.shape[0]):
        j = i
        while j != NOBODY and walk[j] == NOBODY:
            walk[j] = i
            j = who[j]
        if j == NOBODY or walk[j] != i:
            continue
        lowest, k = j, who[j]
        while k != j:
            lowest = min(lowest, k)
            k = who[k]
        while cycle[k] == NOBODY:
            cycle[k] = lowest
            k = who[k]


@part
def find_wait_cycles_of(robots, routes, least, most, found, p, kinds):
    """Find the wait cycles through robots that have stood for `least` to `most` [s].

    It looks only at these and at those that they wait for, since finding the blocking body is slow.
    """
    who = found[WHO]
    who[:] = _UNASKED
    for i in range(robots.shape[0]):
        stood = robots[i]["clocks"]["standing_time"]
        if robots[i]["task"]["alive"] == 0 or stood < least or stood >= most:
            continue
        j = i
        while j != NOBODY and who[j] == _UNASKED:
            who[j] = waits_for(robots, j, routes[j], p, kinds, found[SPARE])
            j = who[j]
    for i in range(robots.shape[0]):
        who[i] = max(who[i], NOBODY)
    find_wait_cycles(who, found[CYCLE], found[SPARE])


@part
def look(robots, found):
    """Find the robot that each of ROBOT[N] yields to, wait cycles and stages; return how many SEEK or are STUCK.

    Recovery leaves only wait cycles that right of way knows.
    """
    who, cycle, stage, broken, count = found[WHO], found[CYCLE], found[STAGE], found[SPARE], 0
    for i in range(robots.shape[0]):
        who[i] = robots[i]["traffic"]["yields_to"]
        stage[i] = WAITS if may_leave(robots[i]) else MOVES
    find_wait_cycles(who, cycle, found[SPARE])
    broken[:] = 0
    for i in range(robots.shape[0]):
        if cycle[i] != NOBODY and stage[i] == MOVES:
            broken[cycle[i]] = 1
    for i in range(robots.shape[0]):
        if stage[i] == MOVES or not _may_search(robots[i]):
            continue
        waited = robots[i]["clocks"]["waiting_time"]
        if cycle[i] != NOBODY and broken[cycle[i]] == 0 and waited >= SEEKS_AFTER:
            stage[i] = SEEKS
        elif waited > STUCK_AFTER and stands_permanently(robots[who[i]]):
            stage[i] = STUCK
        count += stage[i] > WAITS
    return count


class Jams(NamedTuple):
    """The wait-for graph of all standing robots, int32[B, N] each; see jams_of."""

    waits_for: NDArray[np.int32]
    cycle: NDArray[np.int32]
    stage: NDArray[np.int32]


@kernel
def _write_jams(robots, routes, params, kinds, jams, found):
    """Write Jams; see jams_of."""
    who, cycle, stage = jams
    for b in range(robots.shape[0]):
        look(robots[b], found)
        stage[b] = found[STAGE]
        for i in range(robots.shape[1]):
            who[b, i] = waits_for(robots[b], i, routes[b, i], params[0], kinds, found[SPARE])
        find_wait_cycles(who[b], cycle[b], found[SPARE])


def jams_of(
    robots: NDArray[Any], routes: NDArray[np.float32], params: NDArray[Any], kinds: NDArray[Any] | None
) -> Jams:
    """Return for ROBOT[B, N] the robot that each waits for, the lowest of its wait cycle (or NOBODY), and its stage.

    A chain of robots is a queue, a cycle a deadlock (Coffman et al. 1971), whatever options are on. Only a robot that
    has stood for a second or rocked for five waits, and no parked one. routes float32[B, N, R, 2] [m]; params
    PARAMETERS[1]; kinds: see kinds.py.
    """
    jams = Jams(*(np.empty(robots.shape, dtype=np.int32) for _ in range(3)))
    _write_jams(robots, routes, params, kinds, jams, scratch(robots.shape[1]))
    return jams
