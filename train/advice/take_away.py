"""The floor that an advice recommends, as files for other programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from warehouse_env.maps.halls.map_server import Occupancy, write_occupancy
from warehouse_env.maps.halls.saved import write_hall
from warehouse_env.simulation.tasks.demand import draw_orders
from warehouse_env.simulation.tasks.orders import Order, read_orders, write_orders
from warehouse_env.work import OrderSpec

FOLDER = "floor"  # beside the page
HOUR = 3600.0  # [s] of orders that are drawn


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
    floor, keepout, orders = folder / f"{stem}.yaml", folder / "keepout.yaml", folder / "orders.csv"
    how = write_hall(grid, floor).removeprefix(str(floor))
    barred = np.where(_swept(grid, advice.plan), 0, 100).astype(np.int8)
    write_occupancy(Occupancy(barred, grid.cell_size, grid.origin), keepout)
    lanes, graph = folder / f"{stem}{lif.SUFFIX}", folder / f"{stem}{route_graph.SUFFIX}"
    lif.write_lif(grid, lanes)
    route_graph.write_route_graph(grid, graph)
    made, what = _orders(advice, grid)
    write_orders(orders, made)
    return [
        Link(f"{FOLDER}/{path.name}", title, f"{path.name}: {text}")
        for path, title, text in (
            (floor, "Map", f"map_server, a pixel a cell, with pick faces, stations and arrows beside it; every command "
             f"reads it as --map {floor.name}{how}"),
            (keepout, "Keepout mask", "map_server; over your own map it closes all floor that robots did not drive on"),
            (lanes, "Lanes as LIF 1.0.0", "nodes, edges and stations, with one-way rules"),
            (graph, "Lanes for Nav2", "nodes, edges and stations, with one-way rules"),
            (orders, "Orders", f"{what}; for --map {floor.name} --orders {orders.name} of evaluate, record and advise"),
        )
    ]  # fmt: skip


def _orders(advice: Advice, grid: GridMap) -> tuple[Sequence[Order], str]:
    """Return orders for the floor, and what they are: those given, else as many as robots made trips."""
    plan, spec = advice.plan, advice.plan.work.get("orders")
    if spec is not None and spec.file is not None:
        return read_orders(spec.file), "those that were given"
    made = advice.capacity.goals.goals.mean  # a pick and a drop each
    drawn = OrderSpec(per_hour=max(made / 2, 1.0)) if spec is None else spec
    orders = draw_orders(EnvConfig(arrival="stop", orders=drawn), grid, HOUR, plan.seed)
    return orders, f"an hour of {len(orders):,}, drawn at random"


def _swept(grid: GridMap, plan: Plan) -> NDArray[np.bool_]:
    """Return bool[H, W]: where robots drive, and tight floor that their bodies may reach over."""
    driven = largest_region(~grid.occupied)
    if grid.tight is None or plan.kinds is None:
        return driven
    reach = math.ceil(EnvConfig(**plan.kinds.each()).widest_body.farthest / grid.cell_size)
    rows, columns = grid.shape
    padded = np.pad(largest_region(~grid.closed), reach)
    steps = range(2 * reach + 1)
    near = [padded[down : down + rows, right : right + columns] for down in steps for right in steps]
    return np.asarray(np.logical_or.reduce(near) & ~grid.occupied)
