"""Figures of a live world each second: goals per robot-hour, waiting, standing, contacts."""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.render.replay import FLAGS

WINDOW = 120.0  # [s] over which goals an hour are counted
KEPT = 900  # samples, one a second
STANDS = 0.05  # [m/s] below which a robot stands
_ALIVE = 1 << FLAGS.index("alive")


class Sample(NamedTuple):
    """One second of a world; shares are means over its steps."""

    seconds: float  # since the world began
    goals_per_robot_hour: float  # over WINDOW, or since the beginning
    waiting: float  # share of the robots that wait for another
    standing: float  # share that stands
    contacts: int  # so far


class LiveFigures:
    """The samples of a world, `KEPT` at most."""

    def __init__(self) -> None:
        self.samples: deque[Sample] = deque(maxlen=KEPT)
        self._goals: deque[tuple[float, int]] = deque([(0.0, 0)])  # by second, over WINDOW
        self._shares: list[tuple[float, float]] = []

    def add(self, seconds: float, moment: dict[str, NDArray[Any]]) -> Sample | None:
        """Count a moment at `seconds` since the world began; return a sample if it completes a second."""
        alive = (moment["flags"] & _ALIVE) > 0
        many = max(int(alive.sum()), 1)
        waiting = int((alive & (moment["waits_for"] >= 0)).sum())
        standing = int((alive & (np.abs(moment["speed"]) < STANDS)).sum())
        self._shares.append((waiting / many, standing / many))
        last = self.samples[-1].seconds if self.samples else 0.0
        if seconds < int(last) + 1 - 1e-6:
            return None
        goals, contacts, _ = moment["totals"].tolist()
        self._goals.append((seconds, goals))
        while self._goals[1][0] <= seconds - WINDOW + 1e-6:
            self._goals.popleft()
        since, before = self._goals[0]
        rate = (goals - before) / len(alive) / max(seconds - since, 1e-6) * 3600.0
        waits, stands = np.mean(self._shares, axis=0).tolist()
        self._shares.clear()
        sample = Sample(round(seconds, 3), rate, waits, stands, contacts)
        self.samples.append(sample)
        return sample
