"""Plan routes for all robots: each one alone, then replan those that meet until none do.

Large neighbourhood search for fewer meetings (MAPF-LNS2; Li et al. 2022), then for earlier arrivals (MAPF-LNS; Li et
al. 2021). The effort is counted in nodes, not seconds, so that a seed gives the same routes on any machine.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.central.curves import RouteTask
from train.central.floor import CarFloor
from train.central.search import Limits, search
from train.central.traffic import (
    BEGIN,
    END,
    HEADING,
    PIECE,
    RATE,
    Traffic,
    X,
    Y,
    empty_traffic,
    insert,
    passers,
    pose_at,
    who_meets,
)
from train.central.tree import make_tree

Pose = tuple[float, float, float]
Route = NDArray[np.float64]  # [K, PIECE]

_PIECES, _NODES = 512, 120_000  # of a route and of a search at the most
_FINE = 1, 2, 4, 8  # steps, see RouteTask.fine
_SOON, _ALONE = 200, 5_000  # nodes for a robot alone: with a route, and until there is one
_PRICE = 4.0  # [s] of a meeting in a slot
_PATIENCE = 4  # rounds without a gain before prices and searches grow
_MOST = 8  # most robots replanned at once, and most times that prices and searches grow
_LATE = 1000.0  # [s], price of a meeting if none are allowed
_SEARCH = 400  # nodes of a search among others
_REPAIR, _STARTS = 3_000, 4  # nodes per robot until no two meet, after which everything starts again; such starts
_IMPROVE = 300  # nodes per robot, afterwards


class Together(NamedTuple):
    """The result."""

    routes: list[Route]  # of each robot; empty where one has none even alone
    meeting: int  # pairs of robots that still meet
    alone: NDArray[np.float64]  # [s], arrival of each robot alone, as far as known
    stranded: list[int]  # robots without a route even alone
    nodes: int


class _Fleet:
    """All robots with their routes."""

    def __init__(self, starts: Sequence[Pose], goals: Sequence[Pose], floor: CarFloor) -> None:
        robots, slots = len(starts), int(2 * (floor.width + floor.height)) + 100
        self.starts, self.goals, self.floor, self.robots = starts, goals, floor, robots
        self.gates, self.tails = list(goals), [np.empty((0, PIECE)) for _ in starts]
        self.fine = [1] * robots
        self.traffic: Traffic = empty_traffic(robots, _PIECES, slots)
        self.tree, self.later, self.route = make_tree(_NODES), np.zeros(slots + 1, np.int32), np.zeros((_PIECES, PIECE))
        self.met = np.zeros((robots, robots), np.int32)  # slots in which two meet
        self.stamp = self.nodes = 0

    def find(self, i: int, price: float, most: int, enough: int = 0, bound: float = math.inf) -> float:
        """Replan robot i around the robots that are in, and put it in; return its cost [s], inf without a route."""
        tail = self.tails[i]
        seconds = float(tail[-1, END]) if len(tail) else 0.0
        passers(i, self.goals[i], self.traffic, self.floor, self.later)
        self.stamp += 1
        task = RouteTask(i, self.starts[i], self.gates[i], tail, seconds, self.later, price, self.fine[i], self.stamp)
        count, cost, _ = self._search(task, Limits(most, enough or most, bound))
        if count < 0:
            return math.inf
        insert(self.traffic, i, self.route, count, self.floor)
        return cost

    def _search(self, task: RouteTask, limits: Limits) -> tuple[int, float, float]:
        count, cost, begins, looked = search(task, limits, self.traffic, self.floor, self.tree, self.route)
        self.nodes += looked
        return count, cost, begins

    def find_alone(self, i: int) -> bool:
        """Plan robot i without others, if need be in finer steps and through a gate before its goal."""
        self.traffic.counts[:] = 0
        for fine in _FINE:
            self.fine[i], self.gates[i], self.tails[i] = fine, self.goals[i], np.empty((0, PIECE))
            if self.find(i, _PRICE, _ALONE, _SOON) < math.inf:
                return True
            for target in self._targets(i):
                if self._find_gate(i, target, fine) and self.find(i, _PRICE, _ALONE, _SOON) < math.inf:
                    return True
        return False

    def _targets(self, i: int) -> list[Pose]:
        """Return the robot's start and some other poses near its goal, to which ways out of the goal may lead."""
        x, y, _ = self.goals[i]
        others = [pose for j in range(self.robots) if j != i for pose in (self.starts[j], self.goals[j])]
        return [self.starts[i], *sorted(others, key=lambda pose: math.hypot(pose[0] - x, pose[1] - y))[:4]]

    def _find_gate(self, i: int, target: Pose, fine: int) -> bool:
        """Find a way out of a tight goal; reversed it is the tail, and its end is the gate."""
        self.later[:] = 0
        self.stamp += 1
        task = RouteTask(i, self.goals[i], target, np.empty((0, PIECE)), 0.0, self.later, _PRICE, fine, self.stamp)
        count, _, begins = self._search(task, Limits(_ALONE, _SOON, math.inf))
        if count < 0 or begins == 0.0:
            return False
        way = self.route[:count][self.route[:count, BEGIN] < begins - 1e-9].copy()
        way[-1, END] = begins
        self.tails[i] = reversed_route(way)
        self.gates[i] = tuple(map(float, self.tails[i][0, [X, Y, HEADING]]))  # type: ignore[assignment]
        return True

    def arrival(self, i: int) -> float:
        """Return when robot i arrives [s]."""
        return float(self.traffic.pieces[i, self.traffic.counts[i] - 1, END])

    def take_out(self, chosen: Iterable[int]) -> list[Route]:
        """Take robots out; return their routes."""
        kept = [self.traffic.pieces[i, : self.traffic.counts[i]].copy() for i in chosen]
        for i in chosen:
            self.traffic.counts[i] = 0
        return kept

    def put_in(self, chosen: Iterable[int], routes: Sequence[Route]) -> None:
        """Give robots their routes."""
        for i, route in zip(chosen, routes, strict=True):
            insert(self.traffic, i, route, len(route), self.floor)

    def look(self, chosen: Iterable[int]) -> None:
        """Update which robots some robots meet."""
        for i in chosen:
            who_meets(i, self.traffic, self.floor, self.met[i])
            self.met[:, i] = self.met[i]

    def nearness(self, i: int) -> NDArray[np.float64]:
        """Return the least distance of each robot to robot i while robot i drives; itself: inf."""
        middles = self.traffic.middles[: int(self.arrival(i)) + 2]
        near: NDArray[np.float64] = np.hypot(*(middles - middles[:, i : i + 1]).T).min(axis=1)
        near[i] = math.inf
        return near


def reversed_route(route: Route) -> Route:
    """Return a route reversed."""
    back, seconds = route[::-1].copy(), route[-1, END]
    for k, piece in enumerate(route[::-1]):
        back[k, [X, Y, HEADING]] = pose_at(route[None], 0, len(route) - 1 - k, piece[END])
        back[k, BEGIN], back[k, END], back[k, RATE] = seconds - piece[END], seconds - piece[BEGIN], -piece[RATE]
    return back


def _repair(fleet: _Fleet, random: np.random.Generator) -> None:
    """Replan robots that meet, first one, then more, until none meet or the budget is used up."""
    fleet.look(range(fleet.robots))
    failed, budget = 0, fleet.nodes + _REPAIR * fleet.robots
    while fleet.met.any() and fleet.nodes < budget:
        grown = min(1 + failed // _PATIENCE, _MOST)
        chosen = _who_meet(fleet, grown, random)
        before, met = (np.count_nonzero(fleet.met), fleet.met.sum()), fleet.met.copy()
        kept = dict(zip(chosen, fleet.take_out(chosen), strict=True))
        for i in random.permutation(chosen).tolist():
            if fleet.find(i, _PRICE * grown, _SEARCH * grown) == math.inf:
                fleet.put_in([i], [kept[i]])
        fleet.look(chosen)
        after = np.count_nonzero(fleet.met), fleet.met.sum()
        failed = 0 if after < before else failed + 1
        if after > before:
            fleet.put_in(kept, list(kept.values()))
            fleet.met[:] = met


def _who_meet(fleet: _Fleet, size: int, random: np.random.Generator) -> list[int]:
    """Return up to `size` robots: one that meets another, then robots that these meet or come near."""
    pairs = np.argwhere(fleet.met)
    chosen = [int(pairs[random.integers(len(pairs)), 0])]
    while len(chosen) < min(size, fleet.robots):
        near = [j for j in np.flatnonzero(fleet.met[chosen].any(axis=0)).tolist() if j not in chosen]
        if not near:
            distance = fleet.nearness(chosen[random.integers(len(chosen))]) * random.uniform(0.5, 1.5, fleet.robots)
            distance[chosen] = math.inf
            near = [int(np.argmin(distance))]
        chosen.append(near[random.integers(len(near))])
    return chosen


def _improve(fleet: _Fleet, least: NDArray[np.float64], random: np.random.Generator) -> None:
    """Replan one to four robots around a late one, and keep the routes if they arrive earlier in all."""
    budget = fleet.nodes + _IMPROVE * fleet.robots
    while fleet.nodes < budget:
        late = np.array([fleet.arrival(i) for i in range(fleet.robots)]) - least
        late = np.where(late > 1e-3, late, 0.0)
        if not late.any():
            return
        first = int(random.choice(fleet.robots, p=late / late.sum()))
        near = np.argsort(fleet.nearness(first) * random.uniform(0.5, 1.5, fleet.robots))
        chosen = [first, *near[: random.integers(min(4, fleet.robots))].tolist()]
        before = sum(map(fleet.arrival, chosen))
        kept = fleet.take_out(chosen)
        order, total = random.permutation(chosen).tolist(), 0.0
        for n, i in enumerate(order):
            rest = sum(least[k] for k in order[n + 1 :])
            total += fleet.find(i, _LATE, _SEARCH, bound=before - 1e-3 - total - rest)
            if total == math.inf:
                fleet.put_in(chosen, kept)
                break


def plan_together(starts: Sequence[Pose], goals: Sequence[Pose], floor: CarFloor, seed: int = 0) -> Together:
    """Return routes for all robots from their starts to their goals, x, y and heading each; deterministic by seed."""
    fleet, random = _Fleet(starts, goals, floor), np.random.default_rng(seed)
    robots = range(fleet.robots)
    alone: list[Route] = []
    stranded = []
    for i in robots:
        if fleet.find_alone(i):
            alone += fleet.take_out([i])
        else:
            stranded.append(i)
    least = np.array([route[-1, END] for route in alone])
    if stranded:
        return Together([], 0, least, stranded, fleet.nodes)
    for _ in range(_STARTS):
        fleet.put_in(robots, alone)
        _repair(fleet, random)
        if not fleet.met.any():
            _improve(fleet, least, random)
            break
    return Together(fleet.take_out(robots), int(np.count_nonzero(fleet.met)) // 2, least, [], fleet.nodes)
