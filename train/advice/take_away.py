"""The floor that an advice recommends, as files for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from train.advice.changes import Effect
from train.advice.course import Advice
from train.evaluation.pictures import file_name
from train.reporting.page import Link
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls import lif, route_graph
from warehouse_env.maps.halls.saved import write_hall

FOLDER = "floor"  # beside the page


class Recommended(NamedTuple):
    """A floor to take away."""

    grid: GridMap
    effect: Effect | None  # the change, None: the floor as it is

    @property
    def words(self) -> str:
        """The floor in words."""
        if self.effect is None:
            return "the floor as it is, since no change is known to gain anything"
        stands = "; on your own map these shelves still stand" if self.effect.candidate.kind == "aisle" else ""
        return f"the floor with the change that gains most by itself: {self.effect.candidate.text}{stands}"


def recommended(advice: Advice) -> Recommended:
    """Return the floor with the one change that surely gains most; changes were not measured together."""
    gains = [effect for effect in advice.effects if effect.told and effect.gain.mean > 0]
    best = max(gains, key=lambda effect: effect.gain.mean, default=None)
    return Recommended(advice.plan.grid if best is None else best.candidate.grid, best)


def write_floor(advice: Advice, out: Path) -> list[Link]:
    """Write the recommended floor's files to OUT/floor; return links to them."""
    grid, folder = recommended(advice).grid, out / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    stem = file_name(grid.name)
    floor, lanes, graph = (folder / f"{stem}{suffix}" for suffix in (".yaml", lif.SUFFIX, route_graph.SUFFIX))
    how = write_hall(grid, floor).removeprefix(str(floor))
    lif.write_lif(grid, lanes)
    route_graph.write_route_graph(grid, graph)
    text = "map_server, a pixel a cell, with pick faces, stations and arrows beside it; every command reads it as"
    return [
        Link(f"{FOLDER}/{path.name}", title, f"{path.name}: {what}")
        for path, title, what in (
            (floor, "Map", f"{text} --map {floor.name}{how}"),
            (lanes, "Lanes as LIF 1.0.0", "nodes, edges and stations, with one-way rules"),
            (graph, "Lanes for Nav2", "nodes, edges and stations, with one-way rules"),
        )
    ]
