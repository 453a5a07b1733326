"""The floors and the pieces of the traffic study: draws of tasks, changed floors, episodes."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout

MAPS = ("paper46", "narrow", "single_lane")


class Piece(NamedTuple):
    """A piece of the study: its part, its map, and the number of its draw, case or episode."""

    part: str  # routes, replanning or driving
    map: str
    number: int
    seed: int
    system: str = ""  # of driving
    robots: int = 0  # of driving


@cache
def floor(name: str) -> GridMap:
    """Return the map of that name, the same object every time, so that its fields are kept."""
    return make_layout(name)
