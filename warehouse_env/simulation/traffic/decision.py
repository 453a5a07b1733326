"""Right of way in a batch of worlds: rank all robots and grant their stretches before each step.

Wait cycles are resolved by a kernel of its own (deadlock_recovery.py): it includes the manoeuvre search, which takes
long to compile, and few runs need it.
"""

import numpy as np

from warehouse_env.kernel import kernel
from warehouse_env.simulation.physics.trigonometry import ZERO
from warehouse_env.simulation.traffic import local_activation, right_of_way, waits
from warehouse_env.simulation.traffic.reservations import ReservationTable


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
        if not local_activation.activate_rules(robots, persons, routes, commands[b], found, p, kinds):
            continue
        first, following, masks, numbers = scratch.meetings
        numbers[:] = 0
        table = ReservationTable(worlds.paths[b], first, following, masks, numbers)
        right_of_way.rank(robots, order)
        world = right_of_way.Claims(robots, persons, routes, worlds.arcs[b], commands[b], worlds.choices[b], table)
        right_of_way.decide(world, order, p, kinds, setup.floor)
        for r in robots:
            r["traffic"]["pause"] = max(r["traffic"]["pause"] - seconds, ZERO)
        searching += waits.look(robots, found)
    return searching
