"""Right of way in a batch of worlds: all are ranked and granted their stretches before each step.

Rings are dissolved after it, by a kernel of its own: making_room.py pulls in the search for manoeuvres, which takes
long to compile, and few runs come to need it.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import kernel
from warehouse_env.simulation.physics.trigonometry import ZERO
from warehouse_env.simulation.traffic import right_of_way, stepping_in, waits


@kernel
def agree(begin, end, worlds, setup, scratch):
    """Decide on the right of way in the worlds from `begin` to before `end`; return how many robots search a way then.

    Arguments: see step.run.
    """
    (params, kinds), order, found, searching = setup.planned, scratch.order, scratch.found, 0
    p, commands = params[0], worlds.commands[0]
    seconds = p["time_step"] * np.float32(p["repeat"])
    for b in range(begin, end):
        robots, persons, routes = worlds.robots[b], worlds.persons[b], worlds.routes[b]
        if not stepping_in.step_in(robots, persons, routes, commands[b], found, p, kinds):
            continue
        first, following, masks, numbers = scratch.meetings
        numbers[:] = 0
        ways = worlds.paths[b], first, following, masks, numbers
        right_of_way.rank(robots, order)
        world = right_of_way.Claims(robots, persons, routes, worlds.arcs[b], commands[b], worlds.choices[b], ways)
        right_of_way.decide(world, order, p, kinds, setup.floor)
        for r in robots:
            r["traffic"]["pause"] = max(r["traffic"]["pause"] - seconds, ZERO)
        searching += waits.look(robots, found)
    return searching
