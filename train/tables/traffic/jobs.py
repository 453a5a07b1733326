"""The traffic study in pieces, each known again by its identity: draws of tasks, changed floors, episodes."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from train.reporting.rows import Row
from train.tables.code import PLANNING, code_of
from warehouse_env import __version__
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout

MAPS = ("paper46", "narrow", "single_lane")


class Job(NamedTuple):
    """A piece of work: its part of the study, its map, and the number of its draw, case or episode."""

    part: str  # routes, replanning or driving
    map: str
    number: int
    seed: int
    system: str = ""  # of driving
    robots: int = 0  # of driving

    @property
    def identity(self) -> Row:
        """What its rows are known by."""
        within = ("train.tables.", "warehouse_env.", "agents.") if self.part == "driving" else PLANNING
        code = code_of(f"train.tables.traffic.{self.part}", within=within)
        return {**self._asdict(), "version": __version__, "code": code}


@cache
def floor(name: str) -> GridMap:
    """Return the map of that name, the same object every time, so that its fields are kept."""
    return make_layout(name)
