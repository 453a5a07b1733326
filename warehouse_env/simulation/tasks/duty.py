"""A robot's activity in a shift (shift.py), and the length of a service."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, auto

import numpy as np

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
