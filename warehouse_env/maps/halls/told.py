"""The report on a hall: what was read, and what its cells lose."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.files import companion
from warehouse_env.maps import one_way
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.cells import Raster, closed, exceeds, not_free, room_of, spread
from warehouse_env.maps.halls.map_server import Occupancy
from warehouse_env.maps.halls.reading import BEST, Reading


class Laid(NamedTuple):
    """Cells laid over a map."""

    occupancy: Occupancy
    begin: tuple[float, float]  # [m], to the right of and below the picture's corner
    raster: Raster
    walls: NDArray[np.bool_]  # [H, W]


def report(path: Path, how: Reading, laid: Laid, grid: GridMap, barred: NDArray[np.bool_]) -> Iterator[str]:
    """Yield what was read of a hall, and what its cells lose, one sentence each.

    barred: bool[H, W], floor that masks or lanes close.
    """
    pixel = laid.occupancy.resolution**2
    occupied, free, unknown = laid.occupancy.counts
    yield f"pixels of {laid.occupancy.resolution:g} m: {occupied:,} occupied, {free:,} free, {unknown:,} unknown"
    driven = len(grid.free_cells)
    yield (
        f"{grid.shape[0]} x {grid.shape[1]} cells of {how.cell:g} m, of which up to {how.share:.0%} may be not "
        f"free: {driven:,} are driven on, {driven * how.cell**2:,.0f} of the map's {free * pixel:,.0f} m² of free floor"
    )
    yield f"cells begin {_beginning(path, how, laid)}"
    if barred.any():
        yield f"closed by keepout, or off the lanes: {counted(barred.sum(), 'cell')}"
    yield from _aisles(how, laid)
    if unknown:
        other = spread(laid.occupancy, not_free(laid.occupancy.values, how.unknown != "floor"), laid.raster)
        changed = int((exceeds(other, how.share) != laid.walls).sum())
        yield f"{how.unknown} by unknown pixels alone: {counted(changed, 'cell')}"
    for what, given in (("keepout", how.keepout), ("speed", how.speed)):
        mask = path.with_name(f"{path.stem}_{what}.yaml")
        if given is None and mask.exists():
            yield f"{mask.name} lies beside and is not read; {what}={mask.name} reads it"
    x, y = grid.origin
    yield f"its south-west corner is at ({x:g}, {y:g}) m of the map"


def _beginning(path: Path, how: Reading, laid: Laid) -> str:
    """Say where cells begin."""
    right, down = laid.begin
    corner = "the picture's upper left corner"
    if max(laid.begin) > 0:
        where = f"{right:.9g} m to the right of and {down:.9g} m below {corner}"
        return f"{where} (begin={right:.9g}+{down:.9g})" if how.begin == BEST else where
    counted_so = how.begin == BEST and companion(path, one_way.SUFFIX).exists()
    return f"at {corner}" + (f", as {path.stem}{one_way.SUFFIX} counts them" if counted_so else "")


def _places(cells: NDArray[np.bool_]) -> int:
    from warehouse_env.maps.distance import label_regions

    return int(label_regions(cells).max())


def _aisles(how: Reading, laid: Laid) -> Iterator[str]:
    room = spread(laid.occupancy, room_of(laid.occupancy, how.unknown == "floor"), laid.raster) > 0
    lost = closed(room, ~laid.walls)
    if lost.any():
        x, y = laid.raster.centres(np.argwhere(lost)[0]).tolist()
        yield (
            f"aisles close: {counted(_places(lost), 'place')} where a robot has room, "
            f"{counted(lost.sum(), 'cell')} long, one near ({x:.1f}, {y:.1f}) m; a smaller cell= may open them"
        )


def counted(number: int | np.integer[Any], what: str) -> str:
    """Return a number with what it counts, as in "1 cell"."""
    return f"{int(number):,} {what}{'' if number == 1 else 's'}"
