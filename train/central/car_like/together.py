"""Routes for all robots: each alone at first, then neighbourhoods that meet are planned anew until none do.

Large neighbourhood search, first for fewer meetings (MAPF-LNS2; Li et al. 2022), then for earlier arrivals (MAPF-LNS;
Li et al. 2021).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.central.car_like.floor import Floor
from train.central.car_like.search import Work, make_work, search
from train.central.car_like.traffic import END, PIECE, Traffic, empty_traffic, insert, passers, who_meets


class Effort(NamedTuple):
    """How long is looked for routes, in nodes of searches: the same routes on any machine."""

    nodes: int = 400  # of a search
    repair: int = 3_000  # of all searches until no two meet
    improve: int = 300  # a robot, afterwards
    price: float = 4.0  # [s] of a meeting in a slot
    most: int = 8  # robots planned anew at once


class Planned(NamedTuple):
    """What was found: each robot's pieces float64[K, PIECE], pairs that still meet, and nodes looked at."""

    routes: list[NDArray[np.float64]]
    meeting: int
    nodes: int
    rounds: int


class _Planner:
    """The state of one planning."""

    def __init__(self, starts: NDArray[Any], goals: NDArray[Any], floor: Floor, seed: int, effort: Effort) -> None:
        self.starts, self.goals, self.floor, self.effort = starts, goals, floor, effort
        self.robots = len(starts)
        slots = int(4.0 * (floor.width + floor.height)) + 100
        pieces = 512
        self.traffic: Traffic = empty_traffic(self.robots, pieces, slots)
        self.work: Work = make_work(120_000, slots)
        self.route = np.zeros((pieces, PIECE))
        self.random = np.random.default_rng(seed)
        self.fine = np.ones(self.robots, np.int64)
        self.nodes, self.stamp = 0, 0
        self.met = np.zeros((self.robots, self.robots), np.int32)

    def replan(self, i: int, price: float, nodes: int, bound: float = np.inf) -> float:
        """Plan robot i anew among those who are in; return its cost, inf where it has no route."""
        self.stamp += 1
        passers(i, *self.goals[i], self.traffic, self.floor, self.work.later)
        count, cost, looked = search(
            i, self.starts[i], self.goals[i], price, nodes, int(self.fine[i]), bound, self.stamp, self.traffic, self.floor, self.work,
            self.route,
        )  # fmt: skip
        self.nodes += looked
        if count < 0:
            return np.inf
        insert(self.traffic, i, self.route, count, self.floor)
        return cost

    def arrival(self, i: int) -> float:
        return float(self.traffic.pieces[i, self.traffic.counts[i] - 1, END])

    def take_out(self, chosen):
        kept = [self.traffic.pieces[i, : self.traffic.counts[i]].copy() for i in chosen]
        for i in chosen:
            self.traffic.counts[i] = 0
        return kept

    def put_back(self, chosen, kept):
        for i, route in zip(chosen, kept, strict=True):
            insert(self.traffic, i, route, len(route), self.floor)

    def see(self, chosen):
        """Bring up to date who meets whom."""
        for i in chosen:
            who_meets(i, self.traffic, self.floor, self.met[i])
            self.met[:, i] = self.met[i]

    def alone(self) -> bool:
        """Plan each robot as if it were alone."""
        for i in range(self.robots):
            self.traffic.counts[:] = 0
            self.fine[i]=1
            while self.replan(i, 1.0, 200) == np.inf and self.replan(i, 1.0, 15_000) == np.inf and self.fine[i] < 8:
                self.fine[i] *= 2
            if self.traffic.counts[i] == 0:
                self.failed = i
                return False
            self.routes_alone.append(self.route[: self.traffic.counts[i]].copy())
        return True

    def first(self):
        self.routes_alone = []
        if not self.alone():
            return False
        self.put_back(range(self.robots), self.routes_alone)
        self.least = np.array([self.arrival(i) for i in range(self.robots)])
        return True

    def repair(self):
        self.see(range(self.robots))
        rounds = 0
        size = 1
        fails = 0
        while self.met.any() and self.nodes < self.effort.repair * self.robots:
            rounds += 1
            pairs = np.argwhere(np.triu(self.met))
            first = pairs[self.random.integers(len(pairs))]
            chosen = self.neighbours(first, size)
            before = np.count_nonzero(self.met), self.met.sum()
            kept, met = self.take_out(chosen), self.met.copy()
            price = self.effort.price
            for i in self.random.permutation(chosen):
                if self.replan(int(i), price, self.effort.nodes) == np.inf:
                    k=chosen.index(int(i))
                    insert(self.traffic,int(i),kept[k],len(kept[k]),self.floor)
            self.see(chosen)
            after = np.count_nonzero(self.met), self.met.sum()
            if after > before:
                self.take_out(chosen)
                self.put_back(chosen, kept)
                self.met[:] = met
            if after >= before:
                fails += 1
                size = 1 + min(self.effort.most - 1, fails // 3)
            else:
                fails, size = 0, 1
        self.rounds = rounds
        return rounds

    def neighbours(self, first, size):
        """Return robots that meet each other, grown from a pair."""
        chosen = [int(first[0])] if size == 1 else [int(k) for k in first]
        if size == 1 and self.random.random() < 0.5:
            chosen = [int(first[1])]
        frontier = list(chosen)
        while len(chosen) < size:
            near = np.flatnonzero(self.met[chosen].any(axis=0))
            near = [int(k) for k in near if k not in chosen]
            if not near:
                # nearest by way: random others
                rest = [k for k in range(self.robots) if k not in chosen]
                if not rest:
                    break
                c = chosen[self.random.integers(len(chosen))]
                d = self.nearness(c, rest)
                near = [rest[int(np.argmin(d + self.random.random(len(rest)) * 10))]]
            chosen.append(near[self.random.integers(len(near))])
        return chosen

    def nearness(self, c, rest):
        until = int(self.arrival(c)) + 2
        m = self.traffic.middles[:until]
        return np.array([np.min(np.hypot(*(m[:, c] - m[:, k]).T)) for k in rest])

    def improve(self):
        budget = self.nodes + self.effort.improve * self.robots
        gained = 0
        while self.nodes < budget:
            late = np.array([self.arrival(i) for i in range(self.robots)]) - self.least
            late = np.maximum(late, 0.0)
            if late.sum() < 1e-6 * self.robots:
                break
            first = int(self.random.choice(self.robots, p=(late + 1e-9) / (late + 1e-9).sum()))
            size = int(self.random.integers(1, 5))
            chosen = [first]
            rest = [k for k in range(self.robots) if k != first]
            if rest:
                d = self.nearness(first, rest) + self.random.random(len(rest)) * 5
                chosen += [rest[k] for k in np.argsort(d)[: size - 1]]
            before = sum(self.arrival(i) for i in chosen)
            kept = self.take_out(chosen)
            total = 0.0
            order = self.random.permutation(chosen)
            if size>1 and self.random.random()<.3: order=np.array([first]+[k for k in order if k!=first])
            for i in order:
                cost = self.replan(int(i), 1000.0, self.effort.nodes, before - total - sum(self.least[k] for k in order[list(order).index(i)+1:]))
                total += cost
                if total >= before - 1e-6:
                    break
            if total >= before - 1e-6:
                self.take_out(chosen)
                self.put_back(chosen, kept)
            else:
                gained += 1
        return gained


def plan_together(starts, goals, floor, seed=0, effort=Effort()):
    p = _Planner(starts, goals, floor, seed, effort)
    if not p.first():
        return None
    p.repair()
    m = np.count_nonzero(p.met) // 2
    rep=p.nodes
    if m == 0:
        p.improve()
    return p, m, rep
