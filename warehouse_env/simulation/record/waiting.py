"""Statistics of the wait-for graph: the number of deadlocks, and the chain behind the longest stand."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import NOBODY
from warehouse_env.simulation.traffic.waits import SLOW

PERIOD = 1.0  # [s] between two looks; a cycle seen at two of them is a deadlock
AWAY = 1.0  # [m] that a member must move from where it stood to end a deadlock

Cycles = dict[tuple[int, ...], NDArray[Any]]  # members -> their records ROBOT[K] when the cycle was first seen


class WaitingRecord:
    """Count each world's deadlocks of one episode, and find why a robot stood longest. Call it after every step.

    A deadlock ends when a member moves AWAY or reaches a goal. Until then its members are in no other.

    deadlocks: of each world. longest: of each, the longest time that a robot stood within a metre of one place [s], and
    why.
    """

    def __init__(self, simulator: Simulator) -> None:
        """Start at 0; the simulator has just been reset."""
        self._every = max(1, round(PERIOD / (simulator.config.time_step * simulator.config.action_repeat)))
        self._seen: list[Cycles] = [{} for _ in range(simulator.num_worlds)]  # at the last look
        self._open: list[Cycles] = [{} for _ in range(simulator.num_worlds)]
        self.deadlocks = [0] * simulator.num_worlds
        self.longest = [(0.0, "")] * simulator.num_worlds

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Look at the wait-for graph once a PERIOD."""
        if steps % self._every == 0:
            jams = simulator.jams()
            for world, robots in enumerate(simulator.robots):
                self._count(world, robots, jams.cycle[world])
                self._note_longest(world, robots, jams.waits_for[world])

    def _note_longest(self, world: int, robots: NDArray[Any], waits_for: NDArray[np.int32]) -> None:
        leaves = (waits_for == NOBODY) & (abs(robots["motion"]["speed"]) >= SLOW)  # within the metre, but on its way
        standing = np.where(leaves, 0.0, robots["clocks"]["standing_time"])
        robot = int(standing.argmax())
        if standing[robot] > self.longest[world][0]:
            self.longest[world] = float(standing[robot]), why_it_waits(robot, waits_for, robots)

    def _count(self, world: int, robots: NDArray[Any], cycle: NDArray[np.int32]) -> None:
        going_on = {members: then for members, then in self._open[world].items() if not _ended(members, then, robots)}
        involved = {member for members in going_on for member in members}
        seen: Cycles = {}
        for first in np.unique(cycle[cycle != NOBODY]).tolist():
            members = tuple(np.flatnonzero(cycle == first).tolist())
            if involved.isdisjoint(members):
                if members in self._seen[world]:
                    going_on[members] = self._seen[world][members]
                    self.deadlocks[world] += 1
                else:
                    seen[members] = robots[list(members)].copy()
        self._seen[world], self._open[world] = seen, going_on


def _ended(members: tuple[int, ...], then: NDArray[Any], robots: NDArray[Any]) -> bool:
    """Return whether a member has moved AWAY or reached a goal."""
    now = robots[list(members)]
    moved = np.hypot(now["motion"]["x"] - then["motion"]["x"], now["motion"]["y"] - then["motion"]["y"]) > AWAY
    return bool((moved | (now["totals"]["goals"] != then["totals"]["goals"])).any())


def why_it_waits(robot: int, waits_for: NDArray[np.int32], robots: NDArray[Any]) -> str:
    """Return whom a robot waits for, whom that one waits for, and so on to the first that waits for nobody.

    waits_for: int32[N], see `Jams`; robots: ROBOT[N].
    """
    chain = [robot]
    while chain[-1] not in chain[:-1] and waits_for[chain[-1]] != NOBODY:
        chain.append(int(waits_for[chain[-1]]))
    links, last = [f"waits for {other}" for other in chain[1:]], robots[chain[-1]]
    if chain[-1] in chain[:-1]:
        links[-1] += ": a wait cycle"
    elif last["task"]["alive"] == 0:
        links.append("is parked")
    else:
        links.append("drives" if abs(last["motion"]["speed"]) >= SLOW else "stands by itself")
    return f"robot {robot} " + ", which ".join(links)
