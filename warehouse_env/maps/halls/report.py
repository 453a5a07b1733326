"""The report on a hall: what was read, and what its cells lose."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import counted
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.cells import HallOptions, Raster, closed, exceeds, not_free, room_of, spread
from warehouse_env.maps.halls.map_server import Occupancy
from warehouse_env.maps.moves import label_regions


def report_of(
    path: Path, how: HallOptions, occupancy: Occupancy, raster: Raster, grid: GridMap, barred: NDArray[np.bool_]
) -> Iterator[str]:
    """Yield what was read of a hall and what its cells lose, one sentence each.

    barred: bool[H, W], floor that masks or lanes close.
    """
    walls = grid.walls & ~barred
    occupied, free, unknown = occupancy.counts
    yield f"pixels of {occupancy.resolution:g} m: {occupied:,} occupied, {free:,} free, {unknown:,} unknown"
    driven, area = len(grid.free_cells), free * occupancy.resolution**2
    yield (
        f"{grid.shape[0]} x {grid.shape[1]} cells of {how.cell:g} m, of which up to {how.share:.0%} may be not "
        f"free: {driven:,} are driven on, {driven * how.cell**2:,.0f} of the map's {area:,.0f} m² of free floor"
    )
    if barred.any():
        yield f"closed by keepout, or off the lanes: {counted(barred.sum(), 'cell')}"
    yield from _closed_aisles(spread(occupancy, room_of(occupancy, how.unknown == "floor"), raster) > 0, walls, raster)
    if unknown:
        other = spread(occupancy, not_free(occupancy.values, how.unknown != "floor"), raster)
        changed = int((exceeds(other, how.share) != walls).sum())
        yield f"{how.unknown} by unknown pixels alone: {counted(changed, 'cell')}"
    for what, given in (("keepout", how.keepout), ("speed", how.speed)):
        mask = path.with_name(f"{path.stem}_{what}.yaml")
        if given is None and mask.exists():
            yield f"{mask.name} lies beside the map but is not read; {what}={mask.name} reads it"
    x, y = grid.origin
    yield f"its south-west corner is at ({x:g}, {y:g}) m of the map"


def _closed_aisles(room: NDArray[np.bool_], walls: NDArray[np.bool_], raster: Raster) -> Iterator[str]:
    lost = closed(room, ~walls)
    if lost.any():
        x, y = raster.centres(np.argwhere(lost)[0]).tolist()
        yield (
            f"aisles close: {counted(label_regions(lost).max(), 'place')} where a robot has room, "
            f"{counted(lost.sum(), 'cell')} long, one near ({x:.1f}, {y:.1f}) m; a smaller cell= may open them"
        )
