"""A hall: a robot's map and the files beside it, read as a floor of cells, with a report of what was lost.

A name carries parameters as layouts do: "hall.yaml:cell=0.75,keepout=hall_keepout.yaml". Robots drive on the largest
region; `Hall.notes` says what was cut off. Scanned maps nearly always show specks of free floor behind walls and
windows, so they are not an error.
"""

import contextlib
import math
import multiprocessing
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warehouse_env.checked import from_plain, parse_named
from warehouse_env.config import RobotSpec
from warehouse_env.errors import MapError, MapWarning, counted
from warehouse_env.files import STAGED, companion, path_of
from warehouse_env.maps import one_way
from warehouse_env.maps.discs import SUFFIX as DISCS
from warehouse_env.maps.discs import covered, read_discs
from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.grid_map import GridMap, turned
from warehouse_env.maps.halls import lif, places, route_graph
from warehouse_env.maps.halls.cells import (
    HallOptions,
    Raster,
    Sums,
    around,
    choose_offset,
    exceeds,
    not_free,
    raster_of,
    report_of,
    spread,
    within,
)
from warehouse_env.maps.halls.lanes import Lanes, lay, note_bodies, prices
from warehouse_env.maps.halls.map_server import PICTURES, YAMLS, Occupancy, beside, image_of, read_occupancy
from warehouse_env.maps.halls.places import propose, racks
from warehouse_env.maps.moves import label_regions
from warehouse_env.maps.tables import DEAREST

SUFFIXES = (*YAMLS, *PICTURES)
EXAMPLE = "hall.yaml:cell=0.75"
_SAME_YAW = 1e-4  # [rad]: 1 cm in 100 m


@dataclass(frozen=True, eq=False)
class Hall:
    """A hall as read."""

    grid: GridMap
    occupancy: Occupancy
    raster: Raster
    places: places.Places  # picks and stations by name, as the grid has them
    barred: NDArray[np.bool_]  # [H, W], floor of the map that masks or lanes close
    notes: tuple[str, ...]  # what the floor does not represent, one sentence each
    report: tuple[str, ...]  # what was read, and what cells lose


def is_hall(name: object) -> bool:
    """Whether a name is a hall's map, with or without parameters."""
    return isinstance(name, str) and name.partition(":")[0].lower().endswith(SUFFIXES)


def parse(name: str) -> tuple[Path, HallOptions]:
    """Return the path of a hall's map and how to read it; ConfigError or MapError."""
    given, parameters = parse_named(name, "map", EXAMPLE)
    return path_of(STAGED.get(name, given), MapError), from_plain(HallOptions, parameters)


def files_of(name: str) -> Iterator[Path]:
    """Yield the files of a hall, its map first, so that they can travel with jobs."""
    path, how = parse(name)
    named = [beside(path, other, "file") for other in (how.keepout, how.speed, how.lanes) if other]
    for one in (path, *named):
        yield one
        if one.suffix.lower() in YAMLS:
            with contextlib.suppress(MapError):  # reported when it is read
                yield image_of(one)
    yield from (companion(path, suffix) for suffix in (places.SUFFIX, one_way.SUFFIX, DISCS))


def read_floor(name: str) -> GridMap:
    """Return the floor of a hall; warn of what it does not represent (MapWarning)."""
    hall = read_hall(name)
    for note in hall.notes if multiprocessing.parent_process() is None else ():  # a worker's parent has warned already
        warnings.warn(f"{hall.grid.name}: {note}", MapWarning, stacklevel=2)
    return hall.grid


def read_hall(name: str, edited: bool = True) -> Hall:
    """Return a hall; ConfigError or MapError in one sentence if it cannot be read.

    edited: whether to read the file of places beside it, if there is one.
    """
    path, how = parse(name)
    try:
        return _Reader(path, how, edited).hall()
    except MapError as error:
        text = str(error)
        raise MapError(text if text.startswith(str(path.parent)) else f"{path}: {text}") from None


def _check_floor(floor: NDArray[np.bool_], who: str) -> None:
    if not floor.any():
        raise MapError(f"{who} no cell of floor")


class _Reader:
    """A hall as it is read."""

    def __init__(self, path: Path, how: HallOptions, edited: bool) -> None:
        self._path, self._how, self._edited = path, how, edited
        self._notes: list[str] = []
        self._occupancy = read_occupancy(path, how.resolution)
        self._raster = raster_of(self._occupancy, how.cell, self._beginning())
        self._discs = self._read_discs()
        self._taken = not_free(self._occupancy.values, how.unknown == "floor")
        self._taken[within(self._discs, self._occupancy)] = 0
        self._walls = exceeds(spread(self._occupancy, self._taken, self._raster), how.share)

    def hall(self) -> Hall:
        """Read the files beside the map, and put all together."""
        speed = self._speeds()
        barred = self._keepout()
        _check_floor(~(self._walls | barred), "keepout leaves")
        lanes = self._lanes()
        on_cells = None if lanes is None else lay(lanes, ~(self._walls | barred), self._raster)
        arrows, price = self._one_way(), None
        if on_cells is not None:
            if arrows.any() and (arrows != on_cells.one_way).any():
                self._notes.append(f"{self._path.stem}{one_way.SUFFIX} is not used: the lanes give the directions")
            speed, arrows = np.minimum(speed, on_cells.speed), on_cells.one_way
            price = np.minimum(prices(on_cells, self._how.lanes_prefer), DEAREST)
            if self._how.lanes_only:
                barred |= ~on_cells.used & ~self._walls
                _check_floor(~(self._walls | barred), "lanes_only leaves")
        occupied = self._walls | barred
        discs = self._discs - (*self._raster.origin, 0.0)
        taken = occupied | covered(discs.astype(np.float32), occupied.shape, self._how.cell)
        _check_floor(~taken, "discs leave")
        (picks, stations), named = self._places(lanes, taken)
        if lanes is not None:
            self._notes += lanes.noted()
        corner = turned(self._raster.origin, self._raster.yaw)
        grid = GridMap(
            occupied, None, self._how.cell, picks, stations, self._path.stem,  # type: ignore[arg-type]
            np.where(taken, 0, arrows), corner, discs, None, speed, price,  # type: ignore[arg-type]
            yaw=self._raster.yaw,
        )  # fmt: skip
        self._note_regions(taken)
        report = tuple(report_of(self._path, self._how, self._occupancy, self._raster, grid, barred))
        return Hall(grid, self._occupancy, self._raster, named, barred, tuple(self._notes), report)

    def _beginning(self) -> tuple[float, float]:
        """Return where cells begin [m]; arrows beside the map count cells from the corner."""
        if companion(self._path, one_way.SUFFIX).exists():
            return 0.0, 0.0
        return choose_offset(self._occupancy, self._how.cell, self._how.share, self._how.unknown == "floor")

    def _read_discs(self) -> NDArray[np.float64]:
        """Return float64[K, 3], the discs (x, y, radius) [m] whose centres are on cells; x and y as those of origin."""
        path = companion(self._path, DISCS)
        if not path.exists():
            return np.zeros((0, 3))
        found = read_discs(path)
        inside = self._raster.inside(self._raster.cells(found[:, :2]))
        if not inside.all():
            x, y, _ = found[np.argmin(inside)].tolist()
            self._notes.append(
                f"{counted((~inside).sum(), 'disc')} with a centre off the floor are left out, one at ({x:g}, {y:g}) m"
            )
        return np.column_stack([turned(found[:, :2], -self._raster.yaw), found[:, 2]])[inside]

    def _mask(self, name: str, what: str) -> Occupancy:
        """Return a mask beside the map; MapError unless it is turned as the map is."""
        mask, yaw = read_occupancy(beside(self._path, name, what)), self._occupancy.yaw
        if abs(math.remainder(mask.yaw - yaw, math.tau)) > _SAME_YAW:
            raise MapError(f"{what} mask {name} has a yaw of {mask.yaw:g} rad, the map {yaw:g}; turn its picture")
        return mask

    def _note_mask(self, name: str, mask: Occupancy, marked: NDArray[np.bool_], kept: NDArray[np.bool_]) -> None:
        """Note marks of a mask that cells lose; kept: bool[H, W], cells that keep its marks."""
        marks, pixels = Sums(mask, marked, self._how.cell).over(self._raster)
        walls = spread(self._occupancy, self._taken, self._raster)
        lost = (100 * marks > np.maximum(pixels, 1) * (walls + 1)) & ~around(kept) & ~self._walls
        if not marks.any():
            self._notes.append(f"mask {name} marks nothing of the map")
        elif lost.any():
            x, y = self._raster.centres(np.argwhere(lost)[0]).tolist()
            cells = f"{counted(lost.sum(), 'cell')} of {self._how.cell:g} m"
            self._notes.append(
                f"mask {name}: too little of {cells} is marked, as near ({x:.1f}, {y:.1f}) m; try a smaller cell="
            )
        out = (pixels == 0) & ~self._walls
        if out.any():
            floor = int((~self._walls).sum())
            self._notes.append(
                f"mask {name} leaves {out.sum():,} of {floor:,} cells of floor out, which count as unmarked"
            )

    def _keepout(self) -> NDArray[np.bool_]:
        if not (~self._walls).any():
            raise MapError(
                f"no cell of {self._how.cell:g} m is free to {1 - self._how.share:.0%}; choose a smaller cell=, a "
                "larger share=, or look at negate and the thresholds"
            )
        if self._how.keepout is None:
            return np.zeros_like(self._walls)
        mask = self._mask(self._how.keepout, "keepout")
        taken = exceeds(100 * spread(mask, mask.values == 100, self._raster), self._how.share)
        self._note_mask(self._how.keepout, mask, mask.values == 100, taken)
        if ((mask.values > 0) & (mask.values < 100)).any():
            self._notes.append("its keepout mask makes some floor dear without closing it; that floor is open here")
        return np.asarray(taken & ~self._walls)

    def _speeds(self) -> NDArray[np.float64]:
        """Return float64[H, W], the mask's speed limits [m/s]: the mean of a cell's limited pixels; inf for none."""
        if self._how.speed is None:
            return np.full(self._walls.shape, np.inf)
        mask = self._mask(self._how.speed, "speed")
        limited = mask.values > 0
        share, total = (spread(mask, weights, self._raster) for weights in (limited, mask.values * limited))
        self._note_mask(self._how.speed, mask, limited, share > 0.5)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(share > 0.5, total / share / 100 * RobotSpec.max_speed, np.inf)

    def _lanes(self) -> Lanes | None:
        if self._how.lanes is None:
            return None
        path = beside(self._path, self._how.lanes, "lanes")
        if path.suffix.lower() == route_graph.SUFFIX:
            lanes = route_graph.read_route_graph(path)
        elif path.suffix.lower() == ".json":
            lanes = lif.read_lif(path, self._how.vehicle)
        else:
            raise MapError(f"{path} must end in .json (LIF) or {route_graph.SUFFIX} (route graph)")
        of, (rows, columns) = self._occupancy, self._taken.shape
        pixels = Raster(rows, columns, of.resolution, of.origin, of.yaw)
        note_bodies(lanes, self._taken > 0, pixels, RobotSpec.width)
        return lanes

    def _one_way(self) -> NDArray[np.uint8]:
        """Return the directions in the file NAME.oneway beside the map, if there is one."""
        path = companion(self._path, one_way.SUFFIX)
        if not path.exists():
            return np.zeros(self._walls.shape, np.uint8)
        found = one_way.read(path, self._walls.shape)
        if lost := int((self._walls & (found > 0)).sum()):
            total = counted((found > 0).sum(), "one-way cell")
            self._notes.append(f"{path.name}: {lost} of {total} are in walls and left out")
        return np.where(self._walls, 0, found).astype(np.uint8)

    def _places(
        self, lanes: Lanes | None, occupied: NDArray[np.bool_]
    ) -> tuple[list[NDArray[np.int64]], places.Places]:
        """Return the cells of picks and stations, and both by name: from the file, the lanes, or proposed."""
        path = companion(self._path, places.SUFFIX)
        given = dict(lanes.places) if lanes is not None else {}
        if self._edited and path.exists():
            given |= places.read_places(path)
        proposed: Sequence[NDArray[np.int64]] = [np.empty((0, 2), np.int64)] * 2
        if not set(places.KINDS) <= given.keys():
            goods = racks(self._occupancy, self._taken, self._raster, self._walls, self._how.share)
            proposed = propose(occupied, goods, self._walls, self._how.cell)
        region = largest_region(~occupied)
        cells, named = list[NDArray[np.int64]](), places.Places()
        for kind, found in zip(places.KINDS, proposed, strict=True):
            names = None
            if kind in given:
                found, names, notes = places.cells_of(given[kind], kind, region, self._raster)
                self._notes += notes
            cells.append(found)
            named[kind] = places.places_at(self._raster.centres(found), names)
        return cells, named

    def _note_regions(self, occupied: NDArray[np.bool_]) -> None:
        count = int(label_regions(~occupied).max())
        if count > 1:
            lost = int((~occupied).sum() - largest_region(~occupied).sum())
            self._notes.append(
                f"{counted(count - 1, 'region')} with {counted(lost, 'cell')} cut off and "
                "not driven on; a smaller cell= or a larger share= may join them"
            )
