"""What one robot is at: its record in a shift (shift.py)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, auto

from warehouse_env.maps.grid_map import Cell


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
