"""How a hall is read: what stands behind the colon of its name."""

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
    """How a hall is read; files are named as they lie beside the map."""

    cell: float = 1.0  # [m], side of the cells
    begin: str = "best"  # where cells begin: where most is kept, at the picture's corner, or X+Y [m] from there
    share: float = 0.05  # of a cell that may be not free for it to be floor
    unknown: Literal["wall", "floor"] = "wall"  # what pixels count as of which the map knows nothing
    resolution: float | None = None  # [m/pixel] of a plain picture
    keepout: str | None = None  # mask of where nobody drives: a map of map_server
    speed: str | None = None  # mask of how fast, in per cent
    lanes: str | None = None  # LIF (.json) or route graph (.geojson)
    vehicle: str | None = None  # type whose lanes these are (LIF)
    lanes_only: bool = False  # nobody drives off the lanes
    lanes_prefer: float = 1.5  # times its length that a way off the lanes costs planners
    discs: str | None = None  # round obstacles (.json or .csv); pixels in them are theirs

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
        """Where cells begin [m], to the right of and below the picture's corner; None where that is to be chosen."""
        if self.begin == CORNER:
            return 0.0, 0.0
        if not (found := _BEGIN.fullmatch(self.begin)):
            return None
        right, down = map(float, found.groups())
        return (right, down) if max(right, down) < self.cell else None
