"""A log of deadlocks: members, place, duration, and what ended them."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import NOBODY

PERIOD = 1.0  # [s] between two looks; a cycle seen at two of them is a deadlock
AWAY = 1.0  # [m] that a robot must get from where it stood to be out of a deadlock

Ending = Literal["moved on", "new route", "manoeuvre", "episode end"]


class Deadlock(NamedTuple):
    """Robots that waited for each other in a circle."""

    members: tuple[int, ...]
    x: float  # [m], the middle of its members' front axles
    y: float
    begin: float  # [s], when it was first seen
    seconds: float  # until a member had got AWAY from where it stood
    ended_by: Ending  # what that member did: drove on along its route, after a new one, or off it


class _Open(NamedTuple):
    """A deadlock that goes on, and its members' records when it was first seen."""

    members: tuple[int, ...]
    begin: float  # [s]
    robots: NDArray[Any]  # ROBOT[K]


class JamLog:
    """Watch one episode: call it after every step; once a PERIOD it looks for wait cycles."""

    def __init__(self, simulator: Simulator) -> None:
        """Begin with empty logs; the simulator has just been reset."""
        worlds = simulator.num_worlds
        decision = simulator.config.time_step * simulator.config.action_repeat
        self._every = max(1, round(PERIOD / decision))
        self._seen: list[dict[tuple[int, ...], _Open]] = [{} for _ in range(worlds)]  # cycles at the last look
        self._open: list[list[_Open]] = [[] for _ in range(worlds)]
        self._ended: list[list[Deadlock]] = [[] for _ in range(worlds)]
        self._over = [False] * worlds

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Look, if it is time to."""
        if steps % self._every:
            return
        cycle = simulator.jams().cycle
        for world in range(simulator.num_worlds):
            if not self._over[world] and (self._open[world] or self._seen[world] or (cycle[world] != NOBODY).any()):
                self._look(world, simulator.robots[world], cycle[world], simulator.seconds(world))

    def _look(self, world: int, robots: NDArray[Any], cycle: NDArray[np.int32], now: float) -> None:
        endings = [(jam, _ending(jam, robots)) for jam in self._open[world]]
        self._ended[world] += [_closed(jam, now, ending) for jam, ending in endings if ending is not None]
        going_on = [jam for jam, ending in endings if ending is None]
        involved = {member for jam in going_on for member in jam.members}
        seen = {}
        for first in np.unique(cycle[cycle != NOBODY]).tolist():
            members = tuple(np.flatnonzero(cycle == first).tolist())
            if involved.isdisjoint(members):
                before = self._seen[world].get(members)
                if before is None:
                    seen[members] = _Open(members, now, robots[list(members)].copy())
                else:
                    going_on.append(before)
        self._seen[world], self._open[world] = seen, going_on

    def close(self, simulator: Simulator, world: int) -> None:
        """End a world's log with its episode; later calls change nothing."""
        if self._over[world]:
            return
        now = simulator.seconds(world)
        self._ended[world] += [_closed(jam, now, "episode end") for jam in self._open[world]]
        self._open[world], self._over[world] = [], True

    def deadlocks(self, world: int) -> list[Deadlock]:
        """Return the deadlocks of a world that have ended, in the order in which they did."""
        return list(self._ended[world])

    def metrics(self, world: int) -> dict[str, Any]:
        """Return what an episode's row says of its deadlocks: how many, the longest, and all of them."""
        ended = self._ended[world]
        return {
            "deadlocks": float(len(ended)),
            "longest_deadlock_s": max((jam.seconds for jam in ended), default=0.0),
            "deadlock_log": [jam._asdict() for jam in ended],
        }


def _ending(jam: _Open, robots: NDArray[Any]) -> Ending | None:
    """Return what the first member that got away did; None while all stand about where they stood."""
    for member, then in zip(jam.members, jam.robots, strict=True):
        now = robots[member]
        if now["totals"]["goals"] != then["totals"]["goals"]:
            return "moved on"
        if math.hypot(now["motion"]["x"] - then["motion"]["x"], now["motion"]["y"] - then["motion"]["y"]) > AWAY:
            if now["totals"]["reroutes"] != then["totals"]["reroutes"]:
                return "new route"
            return "moved on" if now["on_route"]["position"] - then["on_route"]["position"] > AWAY / 2 else "manoeuvre"
    return None


def _closed(jam: _Open, now: float, ending: Ending) -> Deadlock:
    x, y = (round(float(jam.robots["motion"][axis].mean()), 2) for axis in ("x", "y"))
    return Deadlock(jam.members, x, y, round(jam.begin, 2), round(now - jam.begin, 2), ending)
