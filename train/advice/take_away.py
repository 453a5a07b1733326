"""The floor that an advice recommends, as files that other programs read; each is read back and held against it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice.changes import Effect
from train.advice.course import Advice
from train.advice.trials import Plan
from train.evaluation.pictures import file_name
from train.reporting.page import Link
from warehouse_env.config import EnvConfig
from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls import lif, route_graph
from warehouse_env.maps.halls.cells import Raster
from warehouse_env.maps.halls.hall import read_hall
from warehouse_env.maps.halls.lanes import Lanes, lay
from warehouse_env.maps.halls.map_server import Occupancy, read_occupancy, write_occupancy
from warehouse_env.maps.halls.places import KINDS, cells_of
from warehouse_env.maps.halls.saved import write_hall
from warehouse_env.simulation.tasks.demand import draw_orders
from warehouse_env.simulation.tasks.orders import read_orders, write_orders
from warehouse_env.work import OrderSpec

FOLDER = "floor"  # beside the page
HOUR = 3600.0  # [s] of orders that are drawn


class Recommended(NamedTuple):
    """A floor to take away."""

    grid: GridMap
    effect: Effect | None  # the change that makes it, None: the floor as it is

    @property
    def words(self) -> str:
        """What it is."""
        if self.effect is None:
            return "the floor as it is, since no change was told to bring anything"
        stands = "; on your own map these shelves still stand" if self.effect.candidate.kind == "aisle" else ""
        return f"the floor with the change that brings most by itself: {self.effect.candidate.text}{stands}"


def recommended(advice: Advice) -> Recommended:
    """Return the floor with the one change that is told to bring most; changes were not measured together."""
    told = [effect for effect in advice.effects if effect.told and effect.goals is not None and effect.goals.mean > 0]
    if not told:
        return Recommended(advice.plan.grid, None)
    best = max(told, key=lambda effect: effect.goals.mean if effect.goals is not None else 0.0)
    return Recommended(best.candidate.grid, best)


def write_floor(advice: Advice, out: Path) -> list[Link]:
    """Write the recommended floor's files to the folder beside the page; return links to them, and what each is."""
    grid, folder = recommended(advice).grid, out / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    stem = file_name(grid.name)
    return [_map(grid, folder / f"{stem}.yaml"), _keepout(grid, folder, advice.plan), *_lanes(grid, folder, stem), (
        _orders(advice, grid, folder, f"{stem}.yaml")
    )]  # fmt: skip


def _link(path: Path, title: str, text: str) -> Link:
    return Link(f"{FOLDER}/{path.name}", title, f"{path.name}: {text}")


def _map(grid: GridMap, path: Path) -> Link:
    """Write the floor as cells, with places and arrows beside it."""
    name = write_hall(grid, path)
    back, driven = read_hall(name).grid, _driven(grid)
    there = back.shape == grid.shape and np.allclose(back.origin, grid.origin) and (_driven(back) == driven).all()
    same = there and back.endpoints == grid.endpoints and (back.one_way[driven] == grid.one_way[driven]).all()
    text = "map_server, a pixel a cell, with pick faces, stations and arrows beside it; every command reads it as"
    return _link(path, "Map", f"{text} --map {path.name}{name.removeprefix(str(path))}{_said(bool(same))}")


def _keepout(grid: GridMap, folder: Path, plan: Plan) -> Link:
    """Write what nobody drives on as a mask in the frame of the map."""
    barred = np.where(_swept(grid, plan), 0, 100).astype(np.int8)
    path = folder / "keepout.yaml"
    write_occupancy(Occupancy(barred, grid.cell_size, grid.origin), path)
    same = ((read_occupancy(path).values == 100) == (barred == 100)).all()
    text = "map_server; over your own map it bars all floor that simulated robots did not drive on"
    return _link(path, "Keepout mask", text + _said(bool(same)))


def _lanes(grid: GridMap, folder: Path, stem: str) -> Iterator[Link]:
    """Write the lanes in both formats."""
    for suffix, title, write, read in (
        (lif.SUFFIX, "Lanes as LIF 1.0.0", lif.write_lif, lif.read_lif),
        (route_graph.SUFFIX, "Lanes for Nav2", route_graph.write_route_graph, route_graph.read_route_graph),
    ):
        path = folder / f"{stem}{suffix}"
        write(grid, path)
        yield _link(path, title, f"nodes, edges and stations, one-way rules in them{_said(_is_back(read(path), grid))}")


def _orders(advice: Advice, grid: GridMap, folder: Path, floor: str) -> Link:
    """Write orders to try the floor with: those by which robots were judged, else as many as they made trips."""
    plan, path = advice.plan, folder / "orders.csv"
    spec = plan.work.get("orders")
    if spec is not None and spec.file is not None:
        orders, what = read_orders(spec.file), "those that were given"
    else:
        made = advice.capacity.goals.goals.mean  # a pick and a drop each
        drawn = OrderSpec(per_hour=max(made / 2, 1.0)) if spec is None else spec
        orders = draw_orders(EnvConfig(arrival="stop", orders=drawn), grid, HOUR, plan.seed)
        what = f"an hour of {len(orders):,}, drawn at random"
    write_orders(path, orders)
    return _link(path, "Orders", f"{what}; for --map {floor} --orders {path.name} of evaluate, record and advise")


def _said(same: bool) -> str:
    return "; read back, it is the same floor" if same else "; read back, **it is not quite the same floor**"


def _driven(grid: GridMap) -> NDArray[np.bool_]:
    """Return bool[H, W]: what robots drive on."""
    return largest_region(~grid.occupied)


def _swept(grid: GridMap, plan: Plan) -> NDArray[np.bool_]:
    """Return bool[H, W]: what robots drive on, and of floor that is tight for them what their bodies may reach over."""
    if grid.tight is None or plan.kinds is None:
        return _driven(grid)
    reach = math.ceil(EnvConfig(**plan.kinds.each()).widest_body.farthest / grid.cell_size)
    rows, columns = grid.shape
    padded = np.pad(largest_region(~grid.closed), reach)
    steps = range(2 * reach + 1)
    near = [padded[down : down + rows, right : right + columns] for down in steps for right in steps]
    return np.asarray(np.logical_or.reduce(near) & ~grid.occupied)


def _is_back(lanes: Lanes, grid: GridMap) -> bool:
    """Whether lanes, laid on cells, allow the same steps to the four neighbours, between the same places."""
    floor, raster = largest_region(~grid.closed), Raster(*grid.shape, grid.cell_size, grid.origin)
    on_cells = lay(lanes, floor, raster)
    picks, stations = (cells_of(lanes.places[kind], kind, floor, raster)[0] for kind in KINDS)
    back = GridMap(~floor, None, grid.cell_size, picks, stations, grid.name, on_cells.one_way, grid.origin)  # type: ignore[arg-type]
    steps = np.s_[..., ::2]  # straight ones
    same = (back.legal_moves[steps] == grid.legal_moves[steps])[floor].all()
    places = [set(map(tuple, cells.tolist())) for cells in (picks, stations)]
    return bool(same) and places == [set(map(tuple, cells.tolist())) for cells in (grid.picks, grid.stations)]
