"""The wait-for graph of all standing robots, for pictures and the count of deadlocks, whatever options are on.

A chain of robots in which each waits for the next is a queue. A wait cycle is a deadlock, since each of its robots
waits for another of them (Coffman et al. 1971). What counts as waiting: waits.py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel
from warehouse_env.simulation.traffic import waits


@kernel
def _look(robots, routes, params, kinds, jams, found):
    """Write into int32[B, N] each; see jams_of."""
    who, cycle, stage = jams
    for b in range(robots.shape[0]):
        waits.look(robots[b], found)
        stage[b] = found[waits.STAGE]
        for i in range(robots.shape[1]):
            who[b, i] = waits.waits_for(robots[b], i, routes[b, i], params[0], kinds, found[waits.SPARE])
        waits.find_wait_cycles(who[b], cycle[b], found[waits.SPARE])


class Jams(NamedTuple):
    """The wait-for graph, int32[B, N] each; see jams_of."""

    waits_for: NDArray[np.int32]
    cycle: NDArray[np.int32]
    stage: NDArray[np.int32]


def jams_of(
    robots: NDArray[Any], routes: NDArray[np.float32], params: NDArray[Any], kinds: NDArray[Any] | None
) -> Jams:
    """Return for ROBOT[B, N] whom each robot waits for, the lowest robot of the cycle it is on (NOBODY if none), and
    its stage (waits.MOVES, WAITS, SEEKS or STUCK).

    Only a robot waits that has stood for a second or rocked for five, and nobody that is parked.
    routes float32[B, N, R, 2] [m]; params PARAMETERS[1]; kinds: see kinds.py.
    """
    jams = Jams(*(np.empty(robots.shape, dtype=np.int32) for _ in range(3)))
    _look(robots, routes, params, kinds, jams, waits.scratch(robots.shape[1]))
    return jams
