"""What there is to choose from: `warehouse layouts` and `places` (floors and maps), `policies`, `planners`."""

import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import tyro

from agents import POLICIES, policy_config
from train.advice.changes import runs
from train.reporting.report import Table, require_charts
from train.reporting.rows import Row
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, MapError
from warehouse_env.files import companion
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls import building, lif, places, route_graph
from warehouse_env.maps.halls.hall import Hall, is_hall, parse, read_hall
from warehouse_env.maps.halls.map_server import YAMLS
from warehouse_env.maps.halls.saved import write_hall
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.maps.movingai import write_map
from warehouse_env.maps.one_way import ARROWS
from warehouse_env.planning import PLANNERS
from warehouse_env.traffic_spec import written_traffic

BY_MAP = tyro.conf.arg(aliases=("--map",))  # another name of --layout, which takes files


@dataclass(frozen=True)
class Layouts(Checked):
    """List the layouts; or draw and check a floor, and write it as a picture or as a file of another kind.

    Files are MovingAI's NAME.map, map_server's NAME.yaml with a picture beside it, or a plain picture (PGM, PNG, BMP).
    The name says how a hall is read, as in "hall.yaml:cell=0.75,share=0.1,unknown=floor,keepout=hall_keepout.yaml".
    """

    draw: str | None = None
    """Name of a layout, or a map's file, to draw in the terminal and to check: is it well formed and connected?"""
    png: Path | None = None
    """Also write the drawing as a picture to this file."""
    save: Path | None = None
    """Write the floor named by --draw to this file instead of drawing it: NAME.map (MovingAI), NAME.yaml (map_server,
    with places beside it), NAME.lif.json (lanes as LIF), NAME.geojson (Nav2's route graph) or NAME.building.yaml
    (Open-RMF's traffic editor, with a drawing beside it)."""
    resolution: float | None = None
    """Width of a pixel [m] of what is saved as NAME.yaml (a cell's) or NAME.building.yaml (0.05)."""

    def run(self) -> None:
        """Save or draw the named floor; list all layouts if none is named."""
        if self.draw is None and (self.png is not None or self.save is not None):
            raise ConfigError("--png and --save need --draw NAME_OR_FILE, the floor to write")
        if self.png is not None:
            require_charts(self.png)
        if self.draw is None:
            self._list()
            return
        hall = read_hall(self.draw) if is_hall(self.draw) else None
        grid = make_layout(self.draw) if hall is None else hall.grid
        if self.save is not None:
            self._save(grid, self.save)
        if self.save is None or self.png is not None:
            self._draw(grid, hall)

    def _save(self, grid: GridMap, path: Path) -> None:
        suffix, named = path.suffix.lower(), ""
        if suffix == ".map":
            write_map(grid, path)
        elif path.name.lower().endswith(lif.SUFFIX):
            lif.write_lif(grid, path)
        elif suffix == route_graph.SUFFIX:
            route_graph.write_route_graph(grid, path)
        elif path.name.lower().endswith(building.SUFFIX):
            named = f"; reference_coordinates: {building.write_building(grid, path, self.resolution)}"
        elif suffix in YAMLS:
            named = f", which is read by --map {write_hall(grid, path, self.resolution)}"
        else:
            ends = f"{YAMLS[0]}, {lif.SUFFIX}, {route_graph.SUFFIX} or {building.SUFFIX}"
            raise ConfigError(f"--save {path} must end in .map, {ends}")
        print(f"wrote {path}{named}")

    def _list(self) -> None:
        cells = [
            (
                name,
                f"{row['rows']} x {row['columns']}",
                *(str(row[key]) for key in ("free", "picks", "stations", "narrowest", "max_height_m")),
                (inspect.getdoc(LAYOUTS[name]) or "").split("\n")[0].removeprefix("Return ").rstrip("."),
            )
            for name, row in ((name, facts(make_layout(name))) for name in LAYOUTS)
        ]
        header = ("layout", "cells", "free", "picks", "stations", "narrowest aisle", "floor height [m]", "what it is")
        Table("Layouts", header, tuple(cells)).print()

    def _draw(self, grid: GridMap, hall: Hall | None) -> None:
        """Print the floor, what was read of a hall and what was lost, and whether robots can use it."""
        print("\n".join(grid.text()))
        arrows = f"   {' '.join(ARROWS[1:])} one way" if grid.one_way.any() else ""
        print(f"# shelf   p pick   s station   ~ uneven floor   . floor{arrows}")
        if hall is not None:
            print("\n".join([*hall.report, *(f"note: {text}" for text in hall.notes)]))
        check_connected(grid)
        row = facts(grid)
        left_out = int((~grid.occupied).sum()) - row["free"]
        aside = f", {left_out} free cells are cut off and not used" if left_out else ""
        print(
            f"{grid.name} is good: {row['rows']} x {row['columns']} cells, {row['free']} of them free and "
            f"connected{aside}; {row['picks']} picks, {row['stations']} stations, narrowest aisle {row['narrowest']} "
            f"cells"
        )
        if self.png is not None:
            from warehouse_env.render.charts import paths

            paths(grid, {}, f"{grid.name}: {len(grid.picks)} picks, {len(grid.stations)} stations", self.png)
            print(f"wrote the picture to {self.png}")


def check_connected(grid: GridMap) -> None:
    """Raise MapError, naming an endpoint, unless each endpoint can be reached from every other on a one-way floor."""
    first, *others = grid.endpoints[2]
    region = grid.return_region(first)
    for cell in others:
        if not region[cell]:
            raise MapError(
                f"one-way cells of map {grid.name!r} cut endpoints off: no robot can drive from {first} to {cell} and "
                "back; turn or remove some arrows"
            )


def facts(grid: GridMap) -> Row:
    """Return what a list of floors says about one: sizes in cells, heights in metres."""
    rows, columns = grid.shape
    return {
        "layout": grid.name, "rows": rows, "columns": columns, "free": len(grid.free_cells), "picks": len(grid.picks),
        "stations": len(grid.stations), "narrowest": narrowest_aisle(grid),
        "max_height_m": round(float(np.abs(grid.height).max()), 3),
    }  # fmt: skip


def narrowest_aisle(grid: GridMap) -> int:
    """Return the fewest free cells side by side, in a row or a column, at any cell of the connected floor."""
    numbers = [runs(grid.region, along_row) for along_row in (True, False)]
    return int(min(np.bincount(one[grid.region])[1:].min() for one in numbers))


@dataclass(frozen=True)
class PlacesCommand(Checked):
    """Propose pick faces and stations of a hall, number them in a picture, and write them to NAME.places.json.

    Edit that file by hand: it is read whenever the map is. Stations and lanes of another file fill it as well:
    warehouse places hall.yaml:lanes=hall.lif.json
    """

    map: tyro.conf.Positional[str]
    """The hall: NAME.yaml of map_server, or a picture with :resolution=0.05 behind its name."""
    png: Path | None = None
    """The picture (NAME.places.png beside the map if left out)."""
    propose: bool = False
    """Propose new places, and replace an existing file."""

    rewrites: ClassVar[tuple[str, ...]] = (places.SUFFIX,)

    def run(self) -> None:
        """Write the file, if there is none yet, and the picture."""
        if not is_hall(self.map):
            raise ConfigError(f"{self.map} is no map of a hall: it must be NAME.yaml or a picture")
        require_charts(self.png)
        path, _ = parse(self.map)
        file = companion(path, places.SUFFIX)
        there = file.exists() and not self.propose
        hall = read_hall(self.map, edited=there)
        if not there:
            places.write_places(hall.places, file)
        from warehouse_env.render.charts import draw_places

        picture = self.png or path.with_suffix(".places.png")
        picks, stations = ([place.name for place in hall.places[kind]] for kind in places.KINDS)
        draw_places(hall.grid, picks, stations, picture)
        for note in hall.notes:
            print(f"note: {note}")
        counts = " and ".join(f"{len(listed)} {kind}" for kind, listed in hall.places.items())
        print(f"{'read' if there else 'wrote'} {counts} {'from' if there else 'to'} {file}, drew them in {picture}")


@dataclass(frozen=True)
class Policies(Checked):
    """List the policies by the names that --policy takes."""

    def run(self) -> None:
        """List what each policy is and what it is driven with, unless an option says otherwise."""
        cells = (
            (name, one.summary, "rules" if one.weights is None else "trained weights", _needs(name))
            for name, one in POLICIES.items()
        )
        own = "Also a policy: the folder of a trained one (runs/mine), and your own, FILE.py:CLASS or MODULE:CLASS."
        Table("Policies", ("policy", "what it is", "made of", "driven with"), tuple(cells), own).print()


def _needs(policy: str) -> str:
    """Describe what a policy is driven with."""
    config = policy_config(policy, EnvConfig())
    traffic, predictions = written_traffic(config.traffic_spec), config.sensor.predictions
    return ", ".join([f"traffic {traffic}"] * (traffic != EnvConfig.traffic) + ["predictions"] * predictions) or "-"


@dataclass(frozen=True)
class Planners(Checked):
    """List the planners by the names that --planner takes."""

    def run(self) -> None:
        """List what each planner is, by whom, and whether it heeds a cost map."""
        cells = tuple(
            (
                name, (inspect.getdoc(made) or "").split("\n")[0].rstrip("."),
                "yes" if getattr(made, "takes_cost", False) else "no",
            )
            for name, made in PLANNERS.items()
        )  # fmt: skip
        own = (
            "A name may carry parameters, as in pf_aco:ants=20; a wrong one gets the list. A cost map is what live "
            "routes and routes of several robots ask for. Also a planner: your own, FILE.py:CLASS or MODULE:CLASS."
        )
        Table("Planners", ("planner", "what it is", "cost map"), cells, own).print()
