"""A floor fitted to a body: planners avoid cells where it does not fit, and endpoints lie where it can stand.

A cell is tight if half the body's width does not fit beside its middle, or if only tight cells lead there. Endpoints on
tight cells, or on cells where the body fits at no heading, move to the nearest cell where it does: a wide vehicle
stands in front of a shelf, not at its face. If cells are wide enough for the body, nothing changes.
"""

import dataclasses
import math
import multiprocessing
import warnings
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import MapWarning
from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import make_layout

ROOM = 0.05  # [m] beside a body that drives along the middle of cells
_STANDS = 0.08  # [m] around a standing body: robots are placed with as much
HEADINGS = 8  # at which it may stand, evenly all round
_GRAZE = 1e-9


def load_floor(config: EnvConfig, grid: GridMap | None = None) -> GridMap:
    """Return the floor of a config, or `grid` instead, fitted to the bodies and speeds of its robots.

    Endpoints that they cannot reach raise a MapWarning. The floor stays unchanged if fewer endpoints than robots would
    be left: the caller may place the robots elsewhere.
    """
    if grid is None:
        grid = make_layout(config.layout)
    grid = grid.at_pace(max(robot.max_speed for robot in config.bodies))
    floor, notes = fitted(grid, config.widest_body)
    if len(floor.endpoints[2]) <= config.num_agents < len(grid.endpoints[2]):
        floor, notes = grid, (*notes, "fewer places are left than there are robots, so the floor stays as it is")
    for note in notes if multiprocessing.parent_process() is None else ():  # a worker's parent has warned already
        warnings.warn(f"{grid.name}: {note}", MapWarning, stacklevel=3)
    return floor


def fitted(grid: GridMap, robot: RobotSpec) -> tuple[GridMap, tuple[str, ...]]:
    """Return the floor fitted to a body, and what the floor loses, one sentence each.

    If no pick or no station is left, the floor is returned unchanged, and a sentence says so. Fitting a fitted floor
    again for the same body changes nothing.
    """
    need = 0.5 * robot.width + ROOM
    if need <= 0.5 * grid.cell_size and robot.farthest <= grid.cell_size:
        return grid, ()
    occupied = grid.occupied
    who = f"bodies of {robot.length:g} x {robot.width:g} m"
    sides = np.array(grid.shape) * grid.cell_size
    if robot.width > sides.min() or robot.length > np.hypot(*sides):
        return grid, (f"{who} are larger than the floor; choose smaller robots",)
    tight = (_near(grid.walls, need / grid.cell_size, beyond=True) | _near_discs(grid, need)) & ~occupied
    region = largest_region(~(occupied | tight)) if (~(occupied | tight)).any() else np.zeros_like(occupied)
    tight |= largest_region(~occupied) & ~region  # cut off by tight floor: a robot there may leave over it
    picks, stations, _ = grid.endpoints
    placed = _places_for(grid, robot, region, picks + stations)
    places, lost = [], []
    for what, found in (("pick", placed[: len(picks)]), ("station", placed[len(picks) :])):
        missing = found.count(None)
        if missing == len(found):
            hint = "so the floor stays as it is; choose smaller robots or a wider floor"
            return grid, (f"{who} can reach no {what}, {hint}",)
        if missing:
            lost.append(f"{missing} of {len(found)} {what}s")
        places.append(np.array([cell for cell in found if cell is not None], dtype=np.int64))
    made = dataclasses.replace(grid, tight=tight, picks=places[0], stations=places[1])
    return made, (*_notes(grid, region, need, who, lost), *_turns(grid, region, robot, who))


def opened(grid: GridMap, goal: Cell) -> GridMap:
    """Return a floor whose tight cells around a goal are open, up to the nearest cell that is not tight.

    For goals that a user gives: off the middle of the cell the body may fit.
    """
    if grid.tight is None or not grid.tight[goal]:
        return grid
    free = np.argwhere(~grid.closed)
    reach = int(np.abs(free - goal).max(axis=1).min(initial=max(grid.shape)))
    tight = grid.tight.copy()
    tight[max(goal[0] - reach, 0) : goal[0] + reach + 1, max(goal[1] - reach, 0) : goal[1] + reach + 1] = False
    return dataclasses.replace(grid, tight=tight)


def _notes(grid: GridMap, region: NDArray[np.bool_], need: float, who: str, lost: list[str]) -> list[str]:
    """Return what a floor loses for a body, in sentences."""
    covered = _near(region, math.sqrt(0.5) + need / grid.cell_size, beyond=False)
    closed = grid.region & ~covered
    notes = []
    if closed.any():
        x, y = grid.world(grid.centre(np.argwhere(closed)[0])).tolist()
        size = closed.sum() * grid.cell_size**2
        text = f"{size:.0f} m² of floor close, some near ({x:.1f}, {y:.1f}) m"
        notes.append(f"aisles are too narrow for {who}: {text}")
    if lost:
        notes.append(f"{who} cannot reach {' and '.join(lost)}, which are left out")
    return notes


def _turns(grid: GridMap, region: NDArray[np.bool_], robot: RobotSpec, who: str) -> Iterator[str]:
    """Warn about junctions of one-cell aisles that are too tight to turn in."""
    need = turning_width(robot)
    if need <= grid.cell_size:
        return
    walls = np.pad(grid.occupied, 2, constant_values=True)
    open_ = np.pad(region, 1)  # of the cells and those around the map, as `aside` and `above` are
    aside = open_ & walls[1:-1, :-2] & walls[1:-1, 2:]
    above = open_ & walls[:-2, 1:-1] & walls[2:, 1:-1]
    meet = region & (aside[:-2, 1:-1] | aside[2:, 1:-1]) & (above[1:-1, :-2] | above[1:-1, 2:])
    if meet.any():
        x, y = grid.world(grid.centre(np.argwhere(meet)[0])).tolist()
        size = grid.cell_size
        yield (
            f"{who} need aisles of {need:.1f} m to turn from one into another, and some of {size:g} m meet, as near "
            f"({x:.1f}, {y:.1f}) m: robots may get stuck there; smaller cells leave such aisles out, as in "
            f"hall.yaml:cell={size / 2:g}"
        )


def turning_width(robot: RobotSpec) -> float:
    """Return the least width [m] of two perpendicular aisles between which a body can turn in one sharp turn.

    The body sweeps a ring about the turn's centre, as far beyond the inner corner as the inner circle allows.
    """
    inner = max(robot.least_radius - 0.5 * robot.width, 0.0)
    outer = math.hypot(robot.least_radius + 0.5 * robot.width, max(robot.rear_reach, robot.front_overhang))
    return outer - math.sqrt(0.5) * inner


def _near_discs(grid: GridMap, reach: float) -> NDArray[np.bool_]:
    """Return bool[H, W]: cells whose centre is nearer than `reach` [m] to a disc."""
    near = np.zeros(grid.shape, dtype=np.bool_)
    for x, y, radius in grid.discs.astype(np.float64).tolist():
        ends = grid.cell([(x - radius - reach, y + radius + reach), (x + radius + reach, y - radius - reach)])
        (top, left), (bottom, right) = np.clip(ends, 0, np.array(grid.shape) - 1).tolist()
        rows, columns = np.mgrid[top : bottom + 1, left : right + 1]
        off = grid.centre(np.stack([rows, columns], axis=-1)) - (x, y)
        near[top : bottom + 1, left : right + 1] |= np.hypot(off[..., 0], off[..., 1]) < radius + reach - _GRAZE
    return near


def _near(mask: NDArray[np.bool_], reach: float, beyond: bool) -> NDArray[np.bool_]:
    """Return bool[H, W]: cells whose centre is nearer than `reach` [cells] to a marked cell's square.

    beyond: whether the cells outside of the map are marked.
    """
    from scipy import ndimage  # imported late: it takes long

    marked = np.pad(mask, 1, constant_values=beyond)
    if not marked.any():
        return np.zeros_like(mask)
    half_cells = np.zeros((2 * marked.shape[0] + 1, 2 * marked.shape[1] + 1), np.bool_)
    half_cells[1::2, 1::2] = marked  # the centres; dilation adds sides and corners
    away = ndimage.distance_transform_edt(~ndimage.binary_dilation(half_cells, np.ones((3, 3))))
    return np.asarray(away[3:-3:2, 3:-3:2] < 2 * (reach - _GRAZE))


@lru_cache(maxsize=256)
def _covered(robot: RobotSpec, size: float, heading: float, centred: bool) -> NDArray[np.int64]:
    """Return int64[K, 2]: cells (row, column) of a size [m] that a body in the middle of one touches, with some room.

    The fixed axle's centre is in the middle, or, if centred, the body's.
    """
    half, c, s = 0.5 * size, math.cos(heading), math.sin(heading)
    ahead = 0.0 if centred else 0.5 * robot.length - robot.rear_reach  # of the cell's middle, the body's
    most = math.ceil((robot.farthest + _STANDS) / size) + 1
    steps = np.arange(-most, most + 1)
    row, column = (one.ravel() for one in np.meshgrid(steps, steps, indexing="ij"))
    x, y = column * size - ahead * c, -row * size - ahead * s
    long, wide = 0.5 * robot.length + _STANDS, 0.5 * robot.width + _STANDS
    turned = half * (abs(c) + abs(s))
    apart = (np.abs(x) > half + long * abs(c) + wide * abs(s)) | (np.abs(y) > half + long * abs(s) + wide * abs(c))
    apart |= (np.abs(x * c + y * s) > long + turned) | (np.abs(y * c - x * s) > wide + turned)
    return np.asarray(np.stack([row, column], axis=-1)[~apart])


def stands(grid: GridMap, cell: Cell, robot: RobotSpec, heading: float, centred: bool) -> bool:
    """Whether a body in a cell's middle is free; centred: the body's own middle is there, not the axle's."""
    cells = _covered(robot, grid.cell_size, round(heading % (2 * math.pi), 6), centred) + cell
    if not ((cells >= 0) & (cells < grid.shape)).all() or grid.walls[tuple(cells.T)].any():
        return False
    c, s = math.cos(heading), math.sin(heading)
    off = grid.discs[:, :2] - grid.centre(np.array(cell))
    ahead = 0.0 if centred else 0.5 * robot.length - robot.rear_reach
    x, y = np.abs(off @ (c, s) - ahead), np.abs(off @ (-s, c))
    apart = np.hypot(*(np.maximum(side, 0.0) for side in (x - 0.5 * robot.length, y - 0.5 * robot.width)))
    return bool((apart > grid.discs[:, 2] + _STANDS).all())


def headings_on(grid: GridMap, cell: Cell, robot: RobotSpec) -> list[float]:
    """Return the headings [rad], of HEADINGS, at which a body can stand with its axle in a cell's middle."""
    turns = (2 * math.pi / HEADINGS * k for k in range(HEADINGS))
    return [turn for turn in turns if stands(grid, cell, robot, turn, centred=False)]


def _places_for(grid: GridMap, robot: RobotSpec, region: NDArray[np.bool_], cells: list[Cell]) -> list[Cell | None]:
    """Return for each endpoint the nearest cell of a region on which the body can stand, each once; None without any.

    The cell is in sight of the endpoint: no shelf lies between them.
    """
    stands_on = lru_cache(maxsize=None)(lambda cell: bool(headings_on(grid, cell, robot)))
    reach = math.ceil((robot.farthest + grid.cell_size) / grid.cell_size)
    left, found = region.copy(), list[Cell | None]()
    for cell in cells:
        near = (place for place in _nearest(left, cell, reach) if stands_on(place) and _in_sight(grid, cell, place))
        place = next(near, None)
        found.append(place)
        if place is not None:
            left[place] = False
    return found


def _nearest(mask: NDArray[np.bool_], cell: Cell, reach: int) -> list[Cell]:
    """Return the marked cells around a cell, the nearest first."""
    first = np.maximum(np.array(cell) - reach, 0)
    cells = first + np.argwhere(mask[first[0] : cell[0] + reach + 1, first[1] : cell[1] + reach + 1])
    order = np.argsort(((cells - cell) ** 2).sum(axis=1), kind="stable")
    return [(row, column) for row, column in cells[order].tolist()]


def _in_sight(grid: GridMap, cell: Cell, other: Cell) -> bool:
    """Whether no shelf lies between two cells."""
    count = 4 * max(abs(cell[0] - other[0]), abs(cell[1] - other[1])) + 1
    between = np.rint(np.linspace(cell, other, count)).astype(np.int64)
    return not grid.occupied[tuple(between.T)].any()
