"""Batteries: what robots use up by driving, by their mass and by standing there at all, and what chargers give back.

A robot of mass m under a load l that drives a way s within a time t uses up c (m + l) g s + P t, with the share c of
its weight that driving takes (BatterySpec.resistance) and the power P that it takes at all times.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.work import BatterySpec

GRAVITY = 9.81  # [m/s^2]
_JOULES = 3600.0  # in a watt-hour
CRITICAL = 0.5  # share of BatterySpec.low below which a robot leaves what it is at and charges


class Batteries:
    """The batteries of one world's N robots."""

    def __init__(self, spec: BatterySpec, robot: RobotSpec, count: int) -> None:
        self._spec, self._mass = spec, robot.mass
        self.charge = np.full(count, spec.capacity)  # [Wh]
        self.lowest = self.charge.copy()  # [Wh] in this episode
        self.charged = 0.0  # [s] that robots have charged, all together
        self._seen = np.zeros(count)  # [m] driven when this was last looked at
        self._at = 0.0  # [s], when that was

    def begin(self, rng: np.random.Generator) -> None:
        """Begin an episode, each robot somewhere between low and full."""
        share = rng.uniform(self._spec.low, 1.0, len(self.charge))
        self.charge[:] = self.lowest[:] = share * self._spec.capacity
        self._seen[:] = self._at = self.charged = 0.0

    def use(self, now: float, driven: NDArray[np.float64], load: NDArray[np.float64], at_charger: NDArray[Any]) -> None:
        """Let time go on to `now` [s]; driven [N] [m] since the reset, load [N] [kg], at_charger bool[N]."""
        passed, spec = now - self._at, self._spec
        force = spec.resistance * GRAVITY * (self._mass + load)
        used = force * (driven - self._seen) + spec.standing * passed - at_charger * (spec.power * passed)
        self.charge = np.clip(self.charge - used / _JOULES, 0.0, spec.capacity)
        self.lowest = np.minimum(self.lowest, self.charge)
        self.charged += float(at_charger.sum()) * passed
        self._seen[:], self._at = driven, now

    @property
    def share(self) -> NDArray[np.float64]:
        """What is left, of the capacity [N]."""
        return self.charge / self._spec.capacity

    def row(self, seconds: float) -> dict[str, float]:
        """Return the metrics: time at chargers of all time, the least that any robot had left, and who has none."""
        return {
            "charging_share": self.charged / (len(self.charge) * seconds) if seconds > 0 else np.nan,
            "lowest_charge": float(self.lowest.min()) / self._spec.capacity,
            "stranded": float((self.charge <= 0.0).sum()),
        }
