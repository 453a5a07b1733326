"""Right of way in a batch of worlds: where it applies, and the grants to all robots before each step.

It applies everywhere, or only around robots that have stood for `right_of_way_after` seconds.
A policy that gives way by itself drives closer, and gets more done, than grants allow. But now and then some of its
robots block each other permanently. There the rules apply: around wait cycles (waits.py) and robots that wait for a
parked one, which do not dissolve by themselves; to a robot that stands although it waits for nobody; around any robot
that has stood five times as long; and around people whom robots keep from walking. A queue needs no rules. The radius
grows by a metre for each second of standing, and the rules stay active for a while after the last call. Other robots
drive as commanded; their grants tell the robots under rules what to expect of them.

Wait cycles are resolved by a kernel of its own (deadlock_recovery.py): it includes the manoeuvre search, which takes
long to compile, and few runs need it. What was tried instead: docs/measured/trials.md.
"""

import numpy as np

from warehouse_env.kernel import inline, kernel, part
from warehouse_env.simulation.driver.line import forget_path
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO
from warehouse_env.simulation.state import NOBODY
from warehouse_env.simulation.traffic import right_of_way
from warehouse_env.simulation.traffic.reservations import ReservationTable
from warehouse_env.simulation.traffic.waits import CALM, CYCLE, LONGER, STANDS, WHO, find_wait_cycles_of, is_kept, look

SPREAD = np.float32(1.0)  # [m/s] of standing: the radius around a call in which the rules are active ...
AROUND = np.float32(8.0)  # [m] ... and this far at most


@inline
def _activate_around(x, y, stood, robots):
    """Activate the rules near (x, y) [m], where a robot has stood or kept a person for `stood` [s]."""
    around = min(SPREAD * stood, AROUND)
    for r in robots:
        dx, dy = r["motion"]["x"] - x, r["motion"]["y"] - y
        if dx * dx + dy * dy < around * around:
            r["traffic"]["rules_active"] = CALM


@part
def _activate(robots, persons, routes, found, p, kinds):
    """Activate the rules near robots that have stood and people who are kept; see activate_rules."""
    after = p["right_of_way_after"]
    find_wait_cycles_of(robots, routes, after, LONGER * after, found, p, kinds)
    for i in range(robots.shape[0]):
        motion, stood = robots[i]["motion"], robots[i]["clocks"]["standing_time"]
        if robots[i]["task"]["alive"] == 0 or stood < after:
            continue
        j = found[WHO, i]
        parked = j != NOBODY and robots[j]["task"]["alive"] == 0
        if stood >= LONGER * after or found[CYCLE, i] != NOBODY or parked:
            _activate_around(motion["x"], motion["y"], stood, robots)
        elif j == NOBODY and robots[i]["clocks"]["waiting_time"] >= STANDS:
            robots[i]["traffic"]["rules_active"] = CALM
    for o in persons:
        if is_kept(o):
            _activate_around(o["x"], o["y"], o["kept"], robots)


@inline
def _release(r, side):
    """Let a robot drive as commanded, with a lateral offset `side` [m]."""
    traffic = r["traffic"]
    traffic["yields_to"] = NOBODY
    if r["manoeuvre"]["arcs"] == 0:
        traffic["retreating"] = 0
    if traffic["side"] != side:
        traffic["side"] = side
        forget_path(r)


@part
def activate_rules(robots, persons, routes, commands, found, p, kinds):
    """Set `rules_active` of the robots that keep to their grants: all, or those near a call for the rules.

    robots ROBOT[N] and persons PERSON[M] of a world; routes float32[N, R, 2] [m]; commands float32[N, 2]: speed [m/s]
    and lateral offset [m]; found: see waits.scratch; kinds: see kinds.py. Returns whether anybody is.
    """
    after, seconds, anybody = p["right_of_way_after"], p["time_step"] * np.float32(p["repeat"]), False
    for r in robots:
        r["traffic"]["rules_active"] = ONE if after == ZERO else max(r["traffic"]["rules_active"] - seconds, ZERO)
    if after > ZERO:
        _activate(robots, persons, routes, found, p, kinds)
    for i in range(robots.shape[0]):
        if robots[i]["traffic"]["rules_active"] > ZERO:
            anybody = True
        else:
            _release(robots[i], commands[i, 1])
    return anybody


@kernel
def assign_right_of_way(begin, end, worlds, setup, scratch):
    """Decide on the right of way in the worlds from `begin` to before `end`; return how many robots search a way then.

    Arguments: see step.run.
    """
    (params, kinds), order, found, searching = setup.planned, scratch.order, scratch.found, 0
    p, commands = params[0], worlds.commands[0]
    seconds = p["time_step"] * np.float32(p["repeat"])
    for b in range(begin, end):
        robots, persons, routes = worlds.robots[b], worlds.persons[b], worlds.routes[b]
        if not activate_rules(robots, persons, routes, commands[b], found, p, kinds):
            continue
        first, following, masks, numbers = scratch.meetings
        numbers[:] = 0
        table = ReservationTable(worlds.paths[b], first, following, masks, numbers)
        right_of_way.rank(robots, order)
        world = right_of_way.Claims(robots, persons, routes, worlds.arcs[b], commands[b], worlds.choices[b], table)
        right_of_way.decide(world, order, p, kinds, setup.floor)
        for r in robots:
            r["traffic"]["pause"] = max(r["traffic"]["pause"] - seconds, ZERO)
        searching += look(robots, found)
    return searching
