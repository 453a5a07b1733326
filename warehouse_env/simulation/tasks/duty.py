"""What one robot does in a shift (shift.py), and how long its service takes."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, auto

import numpy as np

from warehouse_env.maps.grid_map import Cell
from warehouse_env.work import ServiceSpec


class Doing(IntEnum):
    """What a robot is at."""

    FREE = auto()  # nothing
    STOP = auto()  # drives to a stop of its work
    SERVED = auto()  # stands there
    WAITS = auto()  # for a cell that another holds: on its way to a place, or there
    RESTS = auto()  # the same, for an order
    CHARGER = auto()  # drives to a charger
    CHARGES = auto()
    BROKEN = auto()  # stands for good: broken down, or without charge


@dataclass
class Duty:
    """What one robot is at."""

    doing: Doing = Doing.FREE
    stops: list[Cell] = field(default_factory=list)  # of its work, to come
    order: int | None = None  # its number, if the work is one
    wants: Cell | None = None  # that it waits for
    since: float = 0.0  # [s], when it began to wait


def service_time(spec: ServiceSpec | None, at_station: bool, rng: np.random.Generator) -> float:
    """Return a service's length [s]: always the mean, or gamma distributed about it; 0 where none takes time."""
    if spec is None:
        return 0.0
    mean = spec.station if at_station else spec.pick
    if spec.variation == 0 or mean == 0:
        return mean
    shape = 1.0 / spec.variation**2
    return float(rng.gamma(shape, mean / shape))
