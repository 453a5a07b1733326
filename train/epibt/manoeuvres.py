"""Manoeuvres back to the route, for robots that stand because no single sequence leads on.

A robot that has stood for a while searches for arcs around shelves and nearby robots (traffic/recovery.py). Then it
drives one arc after the other, each as a sequence of its own (`sequences.PLANNED`), until it chooses another sequence.
"""

import numpy as np
from numpy.typing import NDArray

from train.epibt.sequences import ARC, ARC_SPEED, ARC_STEER, ARC_X, ARC_Y, PLANNED, STAGE, STANDS
from warehouse_env.kernel import kernel
from warehouse_env.simulation.driver.manoeuvre import ARCS
from warehouse_env.simulation.driver.scratch import make_search_scratch
from warehouse_env.simulation.physics.kinematics import curvature, roll
from warehouse_env.simulation.physics.trigonometry import ZERO
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.traffic.recovery import CLOSE, LINE, LINE_HELD, SearchWorld, own_of, recover, write_near

_STOOD, _EVERY = 4.0, 4  # [s] after which a robot searches, in one of so many decisions
_AHEAD, _BACK = np.float32(0.6), np.float32(-0.5)  # [m/s]
_REACHED = np.float32(0.03)  # [m] from its end at which an arc is driven


@kernel
def _go_on(due, arc, done, counts, world, setup, scratch):
    """Write the arc that each robot at rest is to drive next; search for a manoeuvre where one is due."""
    for i in range(due.size):
        motion, task, own, arcs = world.robots[i]["motion"], world.robots[i]["task"], arc[i], world.arcs[i]
        if task["alive"] == 0 or task["age"] <= STAGE:  # it has another goal than the manoeuvre
            own[ARC_SPEED], counts[i] = ZERO, 0
        if motion["speed"] != ZERO:
            continue
        if own[ARC_SPEED] != ZERO and np.hypot(own[ARC_X] - motion["x"], own[ARC_Y] - motion["y"]) < _REACHED:
            own[ARC_SPEED] = ZERO
            done[i] += 1
        if due[i] and own[ARC_SPEED] == ZERO and done[i] >= counts[i]:
            case = LINE_HELD if write_near(i, world, CLOSE, ZERO, setup, scratch.bodies) > 0 else LINE
            done[i], counts[i] = 0, recover(i, case, world, setup, scratch.avoid[:0], scratch, None)
        if own[ARC_SPEED] == ZERO and done[i] < counts[i]:
            length, own[ARC_STEER] = arcs[done[i], 0], arcs[done[i], 1]
            bend = curvature(own[ARC_STEER], own_of(i, setup)["wheelbase"])
            own[ARC_X], own[ARC_Y], _ = roll(motion["x"], motion["y"], motion["heading"], length, bend)
            own[ARC_SPEED] = _AHEAD if length > ZERO else _BACK


class Manoeuvres:
    """The manoeuvres of N robots in each of some worlds."""

    def __init__(self, worlds: int, robots: int) -> None:
        """No robot has one."""
        each = worlds, robots
        self.arc = np.zeros((*each, ARC), np.float32)  # that each drives: see Sequences
        self._arcs, self._scratch = np.zeros((*each, ARCS, 2), np.float32), make_search_scratch(robots)
        self._done, self._counts = np.zeros((2, *each), np.int64)  # arcs
        self._follows = np.zeros(each, np.bool_)

    def go_on(self, simulator: Simulator, world: int, decision: int) -> None:
        """Begin the next arcs of a world before its robots choose."""
        robots = simulator.robots[world].copy()  # a search writes into them
        stood = (robots["task"]["alive"] != 0) & (robots["clocks"]["standing_time"] > _STOOD)
        due = stood & ((np.arange(robots.size) + decision) % _EVERY == 0)
        searched = SearchWorld(robots, simulator.routes[world], simulator.people.persons[world], self._arcs[world])
        progress = self._done[world], self._counts[world]
        _go_on(due, self.arc[world], *progress, searched, simulator.search_setup, self._scratch)

    def keep(self, world: int, held: NDArray[np.int64]) -> None:
        """Drop the manoeuvres of robots that have chosen to drive otherwise; held int64[N]: their sequences."""
        follows = self._follows[world]
        follows[:] = (held == PLANNED) | (follows & (held <= STANDS))
        self.arc[world, ~follows, ARC_SPEED], self._counts[world, ~follows] = 0.0, 0
