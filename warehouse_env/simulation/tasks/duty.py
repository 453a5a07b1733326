"""A robot's activity in a shift (shift.py), the length of a service, and the energy used and given back.

A robot of mass m under a load l that drives a distance s in a time t uses c (m + l) g s + P t. c is the rolling
resistance as a share of its weight (BatterySpec.resistance), P the power that it always takes.

No robot strands: it drives to the nearest charger once its charge falls to 1.5 times the energy of the way there.
"""

from dataclasses import dataclass, field
from enum import IntEnum, auto
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import Cell
from warehouse_env.work import ServiceSpec


class Doing(IntEnum):
    """A robot's activity."""

    FREE = auto()  # has nothing to do
    STOP = auto()  # drives to a stop of its work
    SERVED = auto()  # stands at a stop
    WAITS = auto()  # waits for a cell that another robot holds, at a waiting place or on the way there
    RESTS = auto()  # likewise waits for an order
    CHARGER = auto()  # drives to a charger
    CHARGES = auto()
    BROKEN = auto()  # stands until the reset: broken down, or without charge


@dataclass
class Duty:
    """One robot's activity and work."""

    doing: Doing = Doing.FREE
    stops: list[Cell] = field(default_factory=list)  # still to visit
    order: int | None = None  # the number of its order, if it has one
    wants: Cell | None = None  # the cell that it waits for
    since: float = 0.0  # [s], when it began to wait


def service_time(spec: ServiceSpec | None, at_station: bool, rng: np.random.Generator) -> float:
    """Return a service's length [s]: the mean, or gamma distributed about it; 0 without a spec."""
    if spec is None:
        return 0.0
    mean = spec.station if at_station else spec.pick
    if spec.variation == 0 or mean == 0:
        return mean
    shape = 1.0 / spec.variation**2
    return float(rng.gamma(shape, mean / shape))


GRAVITY = 9.81  # [m/s^2]
_JOULES = 3600.0  # in a watt-hour
_MARGIN = 1.5  # times the shortest way to a charger is kept for it,
_SLOW = 0.5  # [m/s] at which it may have to be driven


class Batteries:
    """The batteries of one world's N robots."""

    def __init__(self, config: EnvConfig, home: NDArray[np.float64]) -> None:
        """home float64[H, W] [m]: the way from each cell to the nearest charger, inf where there is none."""
        assert config.battery is not None
        self.spec, self._home, count = config.battery, home, config.num_agents
        self._mass = np.array([robot.mass for robot in config.robots])  # [kg]
        spec, service = self.spec, config.service
        self._pause = max(service.pick, service.station) if service is not None else 0.0  # [s] before it can go
        self.charge = np.full(count, spec.capacity)  # [Wh]
        self.lowest = self.charge.copy()  # [Wh] in this episode
        self.charged = 0.0  # [s] that robots have charged, all together
        self._seen = np.zeros(count)  # [m] driven when this was last looked at
        self._at = 0.0  # [s], when that was

    def begin(self, rng: np.random.Generator) -> None:
        """Begin an episode, each robot somewhere between low and full."""
        share = rng.uniform(self.spec.low, 1.0, len(self.charge))
        self.charge[:] = self.lowest[:] = share * self.spec.capacity
        self._seen[:] = self._at = self.charged = 0.0

    def use(self, now: float, driven: NDArray[np.float64], load: NDArray[np.float64], at_charger: NDArray[Any]) -> None:
        """Advance the charge to `now` [s]; driven [N] [m] since the reset, load [N] [kg], at_charger bool[N]."""
        passed, spec = now - self._at, self.spec
        force = spec.resistance * GRAVITY * (self._mass + load)
        used = force * (driven - self._seen) + spec.standing * passed - at_charger * (spec.power * passed)
        self.charge = np.clip(self.charge - used / _JOULES, 0.0, spec.capacity)
        self.lowest = np.minimum(self.lowest, self.charge)
        self.charged += float(at_charger.sum()) * passed
        self._seen[:], self._at = driven, now

    def is_critical(self, cells: ArrayLike, load: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return bool[N]: whether a robot at its cell, int[N, 2], with its load [N] [kg] must charge now."""
        return np.asarray(self.charge < self.needed(self._home[tuple(np.transpose(cells))], load))

    def needed(self, way: Any, load: Any) -> Any:
        """Return the reserve [Wh] for a way [m] to a charger under a load [kg]."""
        force = self.spec.resistance * GRAVITY * (self._mass + load)
        return (_MARGIN * way * (force + self.spec.standing / _SLOW) + self.spec.standing * self._pause) / _JOULES

    @property
    def share(self) -> NDArray[np.float64]:
        """Charge as a share of the capacity [N]."""
        return self.charge / self.spec.capacity

    def row(self, seconds: float) -> dict[str, float]:
        """Return the metrics: share of time at chargers, the lowest charge of any robot, and robots without charge."""
        return {
            "charging_share": self.charged / (len(self.charge) * seconds) if seconds > 0 else np.nan,
            "lowest_charge": float(self.lowest.min()) / self.spec.capacity,
            "stranded": float((self.charge <= 0.0).sum()),
        }
