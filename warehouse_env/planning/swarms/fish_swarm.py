"""Artificial fish swarm over way-points, with adaptive vision: a baseline of paper 003."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from warehouse_env.planning.swarms.waypoints import Code, Paths, WaypointSwarm

_TOUCHING = 1e-9  # [cells] below this two fish are at one place


@dataclass(frozen=True)
class FishSwarm(WaypointSwarm):
    """Artificial fish swarm (Li, Shao & Qian 2002), improved by adaptive vision and step (Zhang, Guan & Pu 2016).

    x is a code of K way-points (waypoints.py), its cost the length of the path that it decodes to. Two fish are as far
    apart as their way-points are in the mean (root mean square, cells). In each iteration each fish

    - follows: towards the best fish in sight, by a random part of the step, if that one is better;
    - swarms: likewise towards the middle of the fish in sight, if it is better there;
    - takes the better of the two if it improves on its own place, else preys: looks at `tries` random places in sight,
      one after the other, and goes to the first that is better; if there is none, it stays with probability 1 - roam,
      else makes a random step.

    Nobody follows or swarms where more than the share `crowding` of all fish is in sight. Vision is
    last + (first - last) * exp(-fading * (iteration / iterations)^2), so the swarm searches widely first and finely
    later; the step is a share of it. Paper 003 cites an AFSA that changes its vision and prints no formula; the form is
    that of Zhang, Guan & Pu, and the constants are ours.
    """

    iterations: int = 50
    fish: int = 30
    tries: int = 3
    crowding: float = 0.8  # share of the fish in sight from which a place is too crowded
    vision_first: float = 0.4  # of the map's longer side
    vision_last: float = 1.5  # [cells]
    fading: float = 6.0
    step: float = 1.0  # share of the vision
    roam: float = 0.2

    name: ClassVar[str] = "afsa"
    shares: ClassVar[tuple[str, ...]] = ("crowding", "roam")

    def agents(self) -> int:
        """Number of fish."""
        return self.fish

    def vision(self, iteration: int, side: int) -> float:
        """How far [cells] fish see in an iteration, on a map whose longer side is `side` cells."""
        first = max(self.vision_first * side, self.vision_last)
        fade = math.exp(-self.fading * (iteration / self.iterations) ** 2)
        return self.vision_last + (first - self.vision_last) * fade

    def search(self, paths: Paths, first: Code, rng: np.random.Generator) -> None:
        """Let the fish swim."""
        place, cost = first, paths.cost(first)
        for iteration in range(self.iterations):
            vision = self.vision(iteration, max(paths.shape))
            new, new_cost = self._meet(paths, place, cost, vision, rng)
            hungry = np.flatnonzero(new_cost >= cost)
            new[hungry], new_cost[hungry] = place[hungry], cost[hungry]
            self._prey(paths, new, new_cost, hungry, vision, rng)
            place, cost = new, new_cost
            paths.end_iteration()

    def _meet(
        self, paths: Paths, place: Code, cost: NDArray[np.float64], vision: float, rng: np.random.Generator
    ) -> tuple[Code, NDArray[np.float64]]:
        """Return the better place that each fish reaches by following or swarming, and its cost."""
        gap = place[:, None] - place[None]
        apart = np.sqrt((gap**2).sum(axis=(2, 3)) / self.waypoints)
        seen = apart < vision
        np.fill_diagonal(seen, False)
        count = seen.sum(axis=1)
        free = (count > 0) & (count <= self.crowding * len(place))
        leader = np.where(seen, cost, np.inf).argmin(axis=1)
        middle = np.einsum("ij,jkl->ikl", seen.astype(np.float64), place) / np.maximum(count, 1)[:, None, None]
        best, best_cost = place.copy(), np.full(len(place), np.inf)
        for aim, aim_cost in ((place[leader], cost[leader]), (middle, paths.cost(middle))):
            share = self.step * vision * rng.random(len(place))
            going = np.flatnonzero(free & (aim_cost < cost))
            if not len(going):
                continue
            way = aim[going] - place[going]
            far = np.maximum(np.sqrt((way**2).sum(axis=(1, 2)) / self.waypoints), _TOUCHING)
            there = place[going] + np.minimum(1.0, share[going] / far)[:, None, None] * way
            there_cost = paths.cost(there)
            better = there_cost < best_cost[going]
            best[going[better]], best_cost[going[better]] = there[better], there_cost[better]
        return best, best_cost

    def _prey(
        self, paths: Paths, place: Code, cost: NDArray[np.float64], hungry: NDArray[np.int64], vision: float,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        """Move the hungry fish int64[h], in place."""
        edge = np.array(paths.shape) - 1.0
        for _ in range(self.tries):
            if not len(hungry):
                return
            look = place[hungry] + vision * rng.uniform(-1.0, 1.0, (len(hungry), *place.shape[1:]))
            look = np.clip(look, 0.0, edge)
            look_cost = paths.cost(look)
            better = look_cost < cost[hungry]
            place[hungry[better]], cost[hungry[better]] = look[better], look_cost[better]
            hungry = hungry[~better]
        hungry = hungry[rng.random(len(hungry)) < self.roam]
        if len(hungry):
            stray = self.step * vision * rng.uniform(-1.0, 1.0, (len(hungry), *place.shape[1:]))
            place[hungry] = np.clip(place[hungry] + stray, 0.0, edge)
            cost[hungry] = paths.cost(place[hungry])
