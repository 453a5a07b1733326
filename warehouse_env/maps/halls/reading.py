"""How to read a hall: the parameters after the colon of its name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from warehouse_env.checked import Checked
from warehouse_env.maps.going import DEAREST


@dataclass(frozen=True)
class Reading(Checked):
    """How to read a hall; files are named relative to the map."""

    cell: float = 1.0  # [m], side of the cells
    share: float = 0.05  # of a floor cell that may be not free
    unknown: Literal["wall", "floor"] = "wall"  # what unknown pixels count as
    resolution: float | None = None  # [m/pixel] of a plain picture
    keepout: str | None = None  # mask of closed floor: a map of map_server
    speed: str | None = None  # mask of speed limits in per cent
    lanes: str | None = None  # LIF (.json) or route graph (.geojson)
    vehicle: str | None = None  # only lanes open to this type (LIF)
    lanes_only: bool = False  # close all floor off the lanes
    lanes_prefer: float = 1.5  # price factor of floor off the lanes

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(0.1, 100.0, "cell")
        self._between(0.0, 1.0, "share")
        self._between(1e-3, 100.0, "resolution")
        self._between(1.0, DEAREST, "lanes_prefer")
        self._require(not self.lanes_only or self.lanes is not None, "lanes_only", "false without lanes=FILE")
        self._require(self.vehicle is None or self.lanes is not None, "vehicle", "left out without lanes=FILE")
