"""Random orders: their times (Poisson, or in waves), their goods (classes of demand) and their weights."""

from __future__ import annotations

import itertools
import math

import numpy as np

from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.simulation.tasks.orders import Order
from warehouse_env.work import OrderSpec


class Demand:
    """An endless stream of orders, drawn one by one from its own generator.

    The class (A, B, C, ...) of each pick face is drawn first and stays the same for the whole episode.
    """

    def __init__(self, spec: OrderSpec, grid: GridMap, payload: float, rng: np.random.Generator) -> None:
        self._spec, self._payload, self._rng = spec, payload, rng
        picks, self._stations, _ = grid.endpoints
        shelf = [picks[k] for k in rng.permutation(len(picks))]
        ends = np.round(np.cumsum((0.0, *spec.faces)) * len(shelf)).astype(int)
        self._classes = [shelf[begin:end] or shelf for begin, end in itertools.pairwise(ends)]
        self._shares = np.array(spec.demand) / sum(spec.demand)
        self._now = 0.0  # [s], when the last one came

    def draw(self) -> Order:
        """Return the next order, released no earlier than the last one."""
        spec, rng = self._spec, self._rng
        self._now += float(rng.exponential(3600.0 / spec.per_hour))
        release = math.ceil(self._now / spec.wave) * spec.wave if spec.wave else self._now
        picks: list[Cell] = []
        for _ in range(int(rng.integers(1, spec.picks + 1))):
            faces = self._classes[int(rng.choice(len(self._shares), p=self._shares))]
            picks.append(faces[int(rng.integers(len(faces)))])
        drop = self._stations[int(rng.integers(len(self._stations)))]
        weight = min(float(rng.uniform(0.0, 2 * spec.weight)), self._payload)
        return Order(release, tuple(dict.fromkeys(picks)), drop, release + spec.due, weight)
