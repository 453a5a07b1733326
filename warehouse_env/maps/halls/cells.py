"""From a map's pixels to cells: how it is read, where cells begin, what is lost, and the report on that."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from warehouse_env.checked import Checked
from warehouse_env.config import RobotSpec
from warehouse_env.errors import MapError, counted
from warehouse_env.maps.discs import covered
from warehouse_env.maps.endpoints import beside, largest_region
from warehouse_env.maps.generators import LARGEST
from warehouse_env.maps.grid_map import GridMap, turned
from warehouse_env.maps.halls.map_server import MOST_PIXELS, UNKNOWN, Occupancy
from warehouse_env.maps.moves import beyond, label_regions
from warehouse_env.maps.tables import DEAREST

_STANDS = 5  # weight of an obstacle's area in a cell against floor, so that cells keep off walls
_CLOSED = 2  # cells of floor that a closed aisle cell costs besides its own: goods lie on both sides of it
_MOST_STEPS = 64  # along a cell's side; finer pixels are skipped


@dataclass(frozen=True)
class HallOptions(Checked):
    """How to read a hall: the parameters after the colon of its name. Files are named relative to the map."""

    cell: float = 1.0  # [m], side of the cells
    share: float = 0.05  # of a floor cell that may be not free
    unknown: Literal["wall", "floor"] = "wall"  # what unknown pixels count as
    resolution: float | None = None  # [m/pixel] of a plain picture
    keepout: str | None = None  # mask of closed floor: a map of map_server
    speed: str | None = None  # mask of speed limits in per cent
    lanes: str | None = None  # LIF (.json) or route graph (.geojson)
    vehicle: str | None = None  # only lanes open to this type (LIF)
    lanes_only: bool = False  # close all floor off the lanes
    lanes_prefer: float = 1.5  # price factor of floor off the lanes
    ranges: ClassVar = {
        "cell": (0.1, 100.0), "share": (0.0, 1.0), "resolution": (1e-3, 100.0), "lanes_prefer": (1.0, DEAREST),
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(not self.lanes_only or self.lanes is not None, "lanes_only", "false without lanes=FILE")
        self._require(self.vehicle is None or self.lanes is not None, "vehicle", "left out without lanes=FILE")


@dataclass(frozen=True)
class Raster:
    """Cells over a map: rows and columns of squares with a side [m], and their lower left corner.

    origin, yaw: as those of `Occupancy`.
    """

    rows: int
    columns: int
    cell: float
    origin: tuple[float, float]
    yaw: float = 0.0

    def cells(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return int64[..., 2], the cells (row, column) of points (x, y) [m]; off the floor they lie outside."""
        with np.errstate(invalid="ignore"):
            along = (turned(points, -self.yaw) - self.origin).round(9)  # so that a line between cells keeps to one side
            column = np.floor(along[..., 0] / self.cell)
            row = self.rows - 1 - np.floor(along[..., 1] / self.cell)
        cells: NDArray[np.int64] = np.clip(np.stack([row, column], axis=-1), -(2**40), 2**40).astype(np.int64)
        return cells

    def inside(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return bool[...]: which cells (row, column) there are."""
        return np.asarray(((cells >= 0) & (cells < (self.rows, self.columns))).all(axis=-1))

    def centres(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return float64[..., 2], the centres (x, y) [m] of cells (row, column)."""
        x = self.origin[0] + (cells[..., 1] + 0.5) * self.cell
        y = self.origin[1] + (self.rows - 1 - cells[..., 0] + 0.5) * self.cell
        return turned(np.stack([x, y], axis=-1), self.yaw)


def raster_of(occupancy: Occupancy, cell: float, begin: tuple[float, float] = (0.0, 0.0)) -> Raster:
    """Return the whole cells in a picture; MapError if there are none, or too many.

    begin: where the first cell begins [m], to the right of and below the picture's upper left corner.
    """
    height, width = (n * occupancy.resolution for n in occupancy.values.shape)
    rows, columns = (math.floor(side / cell + 1e-6) for side in (height - begin[1], width - begin[0]))
    if min(rows, columns) < 1:
        raise MapError(f"the map is smaller than a cell of {cell:g} m; choose a smaller cell=")
    if max(rows, columns) > LARGEST:
        raise MapError(f"the map has more than {LARGEST} cells of {cell:g} m in a row; choose a larger cell=")
    x, y = occupancy.origin
    return Raster(rows, columns, cell, (x + begin[0], y + height - begin[1] - rows * cell), occupancy.yaw)


class Sums:
    """Sums of a weight over a map's pixels, from which the sum of any cell follows.

    weights: int[h, w], of the pixels; whole numbers, so sums are exact. cell: width of the cells [m]; a wider pixel
    counts for each cell that it covers.
    """

    def __init__(self, occupancy: Occupancy, weights: NDArray[Any], cell: float) -> None:
        finer = max(1, math.ceil(occupancy.resolution / cell - 1e-6))
        if weights.size * finer**2 > MOST_PIXELS:
            raise MapError(f"its pixels are {finer} cells wide; choose a larger cell=")
        if finer > 1:
            weights = weights.repeat(finer, axis=0).repeat(finer, axis=1)
        self._pixel = occupancy.resolution / finer
        self._corner = (occupancy.origin[0], occupancy.origin[1] + occupancy.values.shape[0] * occupancy.resolution)
        self._before = np.zeros((weights.shape[0] + 1, weights.shape[1] + 1), np.int64)  # above and left of a pixel
        np.cumsum(weights, axis=0, out=self._before[1:, 1:])
        np.cumsum(self._before, axis=1, out=self._before)

    def over(self, raster: Raster) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return int64[H, W], twice: sum and number of the pixels whose centres lie in each cell."""
        down = self._corner[1] - raster.origin[1] - raster.rows * raster.cell
        row = self._edges(down, raster.rows, 0, raster.cell)
        column = self._edges(raster.origin[0] - self._corner[0], raster.columns, 1, raster.cell)
        at = self._before[np.ix_(row, column)]
        strips = at[1:] - at[:-1]
        return strips[:, 1:] - strips[:, :-1], np.outer(row[1:] - row[:-1], column[1:] - column[:-1])

    def _edges(self, begin: float, cells: int, axis: int, cell: float) -> NDArray[np.int64]:
        """Return int64[cells + 1]: the first row or column of pixels with its centre in each cell or behind it."""
        edges = (begin + (np.arange(cells + 1) - 1e-9) * cell) / self._pixel - 0.5
        found: NDArray[np.int64] = np.clip(np.ceil(edges), 0, self._before.shape[axis] - 1).astype(np.int64)
        return found


def spread(occupancy: Occupancy, weights: NDArray[Any], raster: Raster) -> NDArray[np.float64]:
    """Return float64[H, W], the mean weight int[h, w] of the pixels whose centres lie in each cell; 0 without any."""
    total, count = Sums(occupancy, weights, raster.cell).over(raster)
    return total / np.maximum(count, 1)


def not_free(values: NDArray[np.int8], unknown_free: bool) -> NDArray[np.int64]:
    """Return int64[h, w]: how much of each pixel is not free [%]."""
    return np.where(values == UNKNOWN, 0 if unknown_free else 100, values.astype(np.int64))


def exceeds(percent: NDArray[np.float64], share: float) -> NDArray[np.bool_]:
    """Return bool[H, W]: the cells of which more than a share is taken, up to rounding."""
    return percent > 100 * (share + 1e-9)


def within(discs: NDArray[np.float64], occupancy: Occupancy) -> NDArray[np.bool_]:
    """Return bool[h, w]: the pixels that a disc (x, y, radius) [m] of float64[K, 3] meets; x, y as those of origin."""
    return covered(discs - (*occupancy.origin, 0.0), occupancy.values.shape, occupancy.resolution)


def room_of(occupancy: Occupancy, unknown_free: bool) -> NDArray[np.bool_]:
    """Return bool[h, w]: pixels in the middle of a free square as wide as a robot."""
    from scipy import ndimage  # imported late: it takes long

    free = not_free(occupancy.values, unknown_free) == 0
    side = max(1, math.ceil(RobotSpec.width / occupancy.resolution - 1e-6))
    return np.asarray(ndimage.minimum_filter(free, side, mode="constant"))


def closed(room: NDArray[np.bool_], floor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return bool[H, W]: cells where a robot has room in the map but no floor in any neighbouring cell.

    room: bool[H, W], cells with a pixel of `room_of`. Single cells are left out: they are corners.
    """
    found = room & ~around(floor)
    return np.asarray(found & beside(found))


def around(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return bool[H, W]: the cells of a mask and those beside them in any direction."""
    return np.asarray(mask | beyond(mask).any(axis=-1))


def choose_offset(occupancy: Occupancy, cell: float, share: float, unknown_free: bool) -> tuple[float, float]:
    """Return where the cells that keep most of a hall begin [m], to the right of and below the picture's corner.

    A bad choice cuts a strip off every aisle and closes aisles that are hardly wider than a cell. What counts is the
    floor that robots drive on, obstacles in it, and closed aisles. Masks, discs and lanes do not count, so editing them
    does not move the cells. Ties go to the topmost, then the leftmost, so a map drawn in whole cells keeps its cells.
    """
    taken = Sums(occupancy, not_free(occupancy.values, unknown_free), cell)
    room = Sums(occupancy, room_of(occupancy, unknown_free), cell)
    aisle = _CLOSED * 100.0 * (cell / occupancy.resolution) ** 2

    def worth(begin: tuple[float, float], least: float) -> float:
        """Return what cells that begin there keep [% of pixels], or any number up to `least`."""
        raster = raster_of(occupancy, cell, begin)
        here, count = taken.over(raster)
        floor = ~exceeds(here / np.maximum(count, 1), share)
        gain = np.maximum(100 * count - _STANDS * here, 0)  # so that all floor is worth no less than its region
        if gain[floor].sum() <= least:  # even if nothing is cut off or closed; most end here
            return least
        lost = closed(room.over(raster)[0] > 0, floor)
        return float(gain[largest_region(floor)].sum() - aisle * int(lost.sum()))

    best, most = (0.0, 0.0), worth((0.0, 0.0), -math.inf)
    height, width = occupancy.values.shape
    for down in _steps(height, occupancy.resolution, cell):
        for right in _steps(width, occupancy.resolution, cell):
            found = worth((right, down), most)
            if found > most:
                best, most = (right, down), found
    return best


def _steps(pixels: int, resolution: float, cell: float) -> Iterator[float]:
    """Yield where cells may begin [m] along a side so that at least one is whole."""
    wide = math.ceil(cell / resolution - 1e-6)
    for k in range(0, wide, math.ceil(wide / _MOST_STEPS)):
        if k * resolution <= pixels * resolution - cell * (1 - 1e-6):
            yield round(k * resolution, 9)


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
    by = f", and its x axis turned by {math.degrees(grid.yaw):g} degrees" if grid.yaw else ""
    yield f"its south-west corner is at ({x:g}, {y:g}) m of the map{by}"


def _closed_aisles(room: NDArray[np.bool_], walls: NDArray[np.bool_], raster: Raster) -> Iterator[str]:
    lost = closed(room, ~walls)
    if lost.any():
        x, y = raster.centres(np.argwhere(lost)[0]).tolist()
        yield (
            f"aisles close: {counted(label_regions(lost).max(), 'place')} where a robot has room, "
            f"{counted(lost.sum(), 'cell')} long, one near ({x:.1f}, {y:.1f}) m; a smaller cell= may open them"
        )
