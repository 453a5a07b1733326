"""Right of way in a batch of worlds: all are ranked and granted their stretches before each step.

Rings are dissolved after it, by a kernel of its own: making_room.py pulls in the search for manoeuvres, which takes
long to compile, and few runs come to need it.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import kernel
from warehouse_env.simulation.physics.trigonometry import ZERO
from warehouse_env.simulation.traffic import meetings, right_of_way, stepping_in, waits


@kernel
def agree(begin, end, robots, routes, persons, arcs, commands, paths, params, kinds, choices, floor):
    """Decide on the right of way in the worlds from `begin` to before `end`; return how many robots search a way then.

    Arguments: see step.advance; choices float32[B, N, K, 3]: see preferences.py; paths float32[B, N + 1, POSES,
    COLUMNS]: see path_ahead.py, kept from one decision to the next.
    """
    p, searching = params[0], 0
    seconds = p["time_step"] * np.float32(p["repeat"])
    order, found = np.empty(robots.shape[1], np.int32), waits.scratch(robots.shape[1])
    for b in range(begin, end):
        if not stepping_in.step_in(robots[b], persons[b], routes[b], commands[b], found, p, kinds):
            continue
        ways = meetings.scratch(paths[b])
        right_of_way.rank(robots[b], order)
        right_of_way.decide(
            robots[b], persons[b], routes[b], arcs[b], commands[b], choices[b], order, ways, p, kinds,
            floor,
        )  # fmt: skip
        for r in robots[b]:
            r["pause"] = max(r["pause"] - seconds, ZERO)
        searching += waits.look(robots[b], found)
    return searching
