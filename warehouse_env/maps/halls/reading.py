"""How to read a hall: the parameters after the colon of its name."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from warehouse_env.checked import Checked
from warehouse_env.maps.going import DEAREST

BEST, CORNER = "best", "corner"
_BEGIN = re.compile(r"(\d{1,3}(?:\.\d{1,9})?)\+(\d{1,3}(?:\.\d{1,9})?)", re.ASCII)


@dataclass(frozen=True)
class Reading(Checked):
    """How to read a hall; files are named relative to the map."""

    cell: float = 1.0  # [m], side of the cells
    begin: str = "best"  # where cells begin: "best" keeps most, "corner" is the picture's corner, X+Y [m] from there
    share: float = 0.05  # of a floor cell that may be not free
    unknown: Literal["wall", "floor"] = "wall"  # what unknown pixels count as
    resolution: float | None = None  # [m/pixel] of a plain picture
    keepout: str | None = None  # mask of closed floor: a map of map_server
    speed: str | None = None  # mask of speed limits in per cent
    lanes: str | None = None  # LIF (.json) or route graph (.geojson)
    vehicle: str | None = None  # only lanes open to this type (LIF)
    lanes_only: bool = False  # close all floor off the lanes
    lanes_prefer: float = 1.5  # price factor of floor off the lanes
    discs: str | None = None  # round obstacles (.json or .csv), instead of the pixels in them

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(0.1, 100.0, "cell")
        self._between(0.0, 1.0, "share")
        self._between(1e-3, 100.0, "resolution")
        self._between(1.0, DEAREST, "lanes_prefer")
        self._require(not self.lanes_only or self.lanes is not None, "lanes_only", "false without lanes=FILE")
        self._require(self.vehicle is None or self.lanes is not None, "vehicle", "left out without lanes=FILE")
        self._require(self.begin == BEST or self.beginning is not None, "begin", (
            f"{BEST}, {CORNER}, or less than a cell [m] to the right and down from the corner, as 0.25+0.4"
        ))  # fmt: skip

    @property
    def beginning(self) -> tuple[float, float] | None:
        """Where cells begin [m], to the right of and below the picture's corner; None: to be chosen."""
        if self.begin == CORNER:
            return 0.0, 0.0
        if not (found := _BEGIN.fullmatch(self.begin)):
            return None
        right, down = map(float, found.groups())
        return (right, down) if max(right, down) < self.cell else None
