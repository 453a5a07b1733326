"""Count deadlocks: wait cycles that last."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import NOBODY

PERIOD = 1.0  # [s] between two looks; a cycle seen at two of them is a deadlock
AWAY = 1.0  # [m] that a member must move from where it stood to end a deadlock

Cycles = dict[tuple[int, ...], NDArray[Any]]  # members -> their records ROBOT[K] when the cycle was first seen


class DeadlockCounter:
    """Count each world's deadlocks of one episode. Call it after every step.

    A deadlock ends when a member moves AWAY or reaches a goal. Until then its members are in no other.
    """

    def __init__(self, simulator: Simulator) -> None:
        """Start at 0; the simulator has just been reset."""
        self._every = max(1, round(PERIOD / (simulator.config.time_step * simulator.config.action_repeat)))
        self._seen: list[Cycles] = [{} for _ in range(simulator.num_worlds)]  # at the last look
        self._open: list[Cycles] = [{} for _ in range(simulator.num_worlds)]
        self.counts = [0] * simulator.num_worlds

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Look for wait cycles once a PERIOD."""
        if steps % self._every == 0:
            for world, cycle in enumerate(simulator.jams().cycle):
                self._look(world, simulator.robots[world], cycle)

    def _look(self, world: int, robots: NDArray[Any], cycle: NDArray[np.int32]) -> None:
        going_on = {members: then for members, then in self._open[world].items() if not _ended(members, then, robots)}
        involved = {member for members in going_on for member in members}
        seen: Cycles = {}
        for first in np.unique(cycle[cycle != NOBODY]).tolist():
            members = tuple(np.flatnonzero(cycle == first).tolist())
            if involved.isdisjoint(members):
                if members in self._seen[world]:
                    going_on[members] = self._seen[world][members]
                    self.counts[world] += 1
                else:
                    seen[members] = robots[list(members)].copy()
        self._seen[world], self._open[world] = seen, going_on


def _ended(members: tuple[int, ...], then: NDArray[Any], robots: NDArray[Any]) -> bool:
    """Return whether a member has moved AWAY or reached a goal."""
    now = robots[list(members)]
    moved = np.hypot(now["motion"]["x"] - then["motion"]["x"], now["motion"]["y"] - then["motion"]["y"]) > AWAY
    return bool((moved | (now["totals"]["goals"] != then["totals"]["goals"])).any())
