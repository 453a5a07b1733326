"""Lanes of a hall: a graph in metres, laid on cells as directions; and a floor as lanes.

A lane's line becomes steps between neighbouring cells. A step that no lane takes back is one-way. A cell gets a
direction if one-way steps lead through it. A one-way step not yet kept gives its direction to its first or second cell,
if that bars no other step. Steps without a lane cost planners more (`prices`).
"""

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import shown
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.cells import Raster
from warehouse_env.maps.halls.places import Place
from warehouse_env.maps.moves import shifted

STEPS = ((0, 1), (-1, 0), (0, -1), (1, 0))  # east, north, west, south, as one_way.ARROWS from 1 on
_SHOWN = 5  # faults of a kind
_FINE = 8  # points of a line looked at per cell
_SLACK = 0.21  # pixels: half a diagonal, by which a point lies off its pixel's middle, less half of the taken one
MOST = 200_000  # nodes or edges of a file


class Lane(NamedTuple):
    """A directed way from one node to another."""

    name: str
    start: str
    end: str
    line: NDArray[np.float64]  # [K, 2], (x, y) [m] of its course
    speed: float = np.inf  # [m/s] at most
    price: float = 1.0  # times its length that it costs
    layout: str = ""  # that it is of, in a file of several

    @property
    def label(self) -> str:
        """Its name in a note."""
        return f"edge {shown(self.name)}" + (f" of layout {shown(self.layout)}" if self.layout else "")


@dataclass
class Lanes:
    """Nodes by name, at (x, y) [m], lanes between them, places, and notes on the reading.

    faults: kind of contradiction -> a sentence for each.
    """

    nodes: dict[str, tuple[float, float]] = field(default_factory=dict)
    lanes: list[Lane] = field(default_factory=list)
    places: dict[str, tuple[Place, ...]] = field(default_factory=dict)
    notes: Counter[str] = field(default_factory=Counter)
    faults: dict[str, list[str]] = field(default_factory=dict)

    def noted(self) -> list[str]:
        """Return the notes as sentences; of many faults of a kind, the first ones."""
        notes = [text if count == 1 else f"{text} ({count} times)" for text, count in self.notes.items()]
        for kind, sentences in self.faults.items():
            more = len(sentences) - _SHOWN
            notes += [*sentences[:_SHOWN], *([f"{more} more {kind}"] if more > 0 else [])]
        return notes

    def fault(self, kind: str, sentence: str) -> None:
        """Keep a fault."""
        self.faults.setdefault(kind, []).append(sentence)


class OnCells(NamedTuple):
    """Lanes on cells."""

    one_way: NDArray[np.uint8]  # [H, W], as in GridMap
    used: NDArray[np.bool_]  # [H, W], cells with a lane
    speed: NDArray[np.float64]  # [H, W], [m/s] at most, inf where no lane says
    price: NDArray[np.float64]  # [H, W, 4], times their length that STEPS cost, inf where no lane takes them


def lay(lanes: Lanes, floor: NDArray[np.bool_], raster: Raster) -> OnCells:
    """Lay lanes on cells of floor; what cells cannot represent goes into the notes."""
    steps = np.zeros((*floor.shape, 4), dtype=np.bool_)
    speed, price, off_floor = np.full(floor.shape, np.inf), np.full(steps.shape, np.inf), []
    for lane in lanes.lanes:
        cells = _cells_along(lane, raster)
        there = raster.inside(cells)
        good = np.zeros(len(cells), dtype=np.bool_)
        good[there] = floor[tuple(cells[there].T)]
        if not (len(good) and good.all()):
            x, y = (raster.centres(cells[np.argmin(good)]) if len(cells) else lane.line[0]).tolist()
            off_floor.append(f"{lane.name} near ({x:.1f}, {y:.1f}) m")
        on_way = _steps_of(cells, good)
        steps[on_way] = True
        price[on_way] = np.minimum(price[on_way], lane.price)
        on = tuple(cells[good].T)
        speed[on] = np.minimum(speed[on], lane.speed)
    if off_floor:
        lead = f"{len(off_floor)} of {len(lanes.lanes)} lanes leave the floor; only their part on the floor counts"
        lanes.notes[f"{lead}: the first is {off_floor[0]}"] += 1
    one_way, open_steps = arrows(steps)
    if open_steps:
        lanes.notes["one-way steps cross or meet so closely that cells cannot keep them"] += open_steps
    used: NDArray[np.bool_] = np.asarray(steps.any(axis=2))
    for move, (row, column) in enumerate(STEPS):
        used |= shifted(steps[..., move], -row, -column)
    return OnCells(np.where(floor, one_way, 0).astype(np.uint8), used, speed, price)


def note_bodies(lanes: Lanes, taken: NDArray[np.bool_], pixels: Raster, width: float) -> None:
    """Note lanes along which a robot of this width [m] surely does not fit between pixels bool[h, w] that are taken."""
    from scipy import ndimage  # imported late: it takes long

    apart = ndimage.distance_transform_edt(~np.pad(taken, 1, constant_values=True))[1:-1, 1:-1]  # between middles
    for lane in lanes.lanes:
        cells = _cells_along(lane, pixels)
        cells = cells[pixels.inside(cells)]
        found = apart[tuple(cells.T)]
        if len(found) and (found.min() + _SLACK) * pixels.cell < width / 2:
            x, y = pixels.centres(cells[np.argmin(found)]).tolist()
            free = max(2 * (found.min() - 0.5) * pixels.cell, 0.0)
            where = f"near ({x:.1f}, {y:.1f}) m, where {free:.2f} m are free around the lane"
            sentence = f"{lane.label}: a robot {width:g} m wide does not fit {where}"
            lanes.fault("edges on which a robot does not fit", sentence)


def _steps_of(cells: NDArray[np.int64], good: NDArray[np.bool_]) -> tuple[NDArray[np.int64], ...]:
    """Return (rows, columns, indices into STEPS) of the steps of a walk whose cells are both on floor."""
    moves = (cells[1:] - cells[:-1])[:, None] == STEPS
    along = moves.all(axis=2) & (good[1:] & good[:-1])[:, None]
    at, move = np.nonzero(along)
    return (*cells[at].T, move)


def prices(on_cells: OnCells, prefer: float) -> NDArray[np.float64]:
    """Return float64[H, W, 8], price factors of moves (GridMap.price): `prefer` off lanes.

    A diagonal move costs the mean of the cheaper pair of steps that leads there. If a lane costs less than its length,
    all prices are scaled so that the cheapest is 1.
    """
    steps = np.where(np.isfinite(on_cells.price), on_cells.price, prefer)
    steps = steps / min(1.0, steps.min())
    price = np.empty((*steps.shape[:2], 8))
    price[..., ::2] = steps
    for move, by in enumerate(STEPS):
        other = (move + 1) % 4
        first = steps[..., move] + shifted(steps[..., other], *by, "edge")
        second = steps[..., other] + shifted(steps[..., move], *STEPS[other], "edge")
        price[..., 2 * move + 1] = 0.5 * np.minimum(first, second)
    return price


def _cells_along(lane: Lane, raster: Raster) -> NDArray[np.int64]:
    """Return int64[K, 2], the cells that a line crosses, each a neighbour of the last; none if it is far away."""
    reach = 4 * (raster.rows + raster.columns + 8) * raster.cell
    lengths = np.hypot(*np.diff(lane.line, axis=0).T)
    if not np.isfinite(lane.line).all() or lengths.sum() > reach:
        return np.empty((0, 2), dtype=np.int64)
    points = [lane.line[:1]]
    for start, end, length in zip(lane.line, lane.line[1:], lengths, strict=False):
        count = max(1, int(np.ceil(length / raster.cell * _FINE)))
        points.append(start + (end - start) * (np.arange(1, count + 1) / count)[:, None])
    cells = raster.cells(np.concatenate(points))
    cells = cells[np.concatenate([[True], (np.diff(cells, axis=0) != 0).any(axis=1)])]
    walk = [cells[0]]
    for cell in cells[1:]:
        if np.abs(cell - walk[-1]).sum() > 1:  # over a corner: by the cell beside
            walk.append(np.array([walk[-1][0], cell[1]]))
        walk.append(cell)
    return np.array(walk)


def arrows(steps: NDArray[np.bool_]) -> tuple[NDArray[np.uint8], int]:
    """Return uint8[H, W], directions that keep one-way steps, and the number of steps that they cannot keep.

    steps: bool[H, W, 4], the steps of lanes from each cell.
    """
    back = np.stack([shifted(steps[..., (m + 2) % 4], *by) for m, by in enumerate(STEPS)], axis=-1)
    single = steps & ~back
    into = np.stack([shifted(single[..., m], -r, -c) for m, (r, c) in enumerate(STEPS)], axis=-1)
    through = single & into
    lone = through.sum(axis=2) == 1
    held = np.where(lone, np.argmax(through, axis=2) + 1, 0).astype(np.uint8)
    lost = 0
    for row, column, move in np.argwhere(single).tolist():
        ends = ((row, column), (row + STEPS[move][0], column + STEPS[move][1]))
        if any(held[end] == move + 1 for end in ends):
            continue
        able = [end for end in ends if not held[end] and not _bars(steps, end, move)]
        if able:
            held[able[0]] = move + 1
        else:
            lost += 1
    return held, lost


def _bars(steps: NDArray[np.bool_], cell: tuple[int, int], move: int) -> bool:
    """Whether a direction on a cell would bar a lane's step out of it or into it."""
    row, column = cell[0] + STEPS[move][0], cell[1] + STEPS[move][1]
    inside = 0 <= row < steps.shape[0] and 0 <= column < steps.shape[1]
    back = (move + 2) % 4
    return bool(steps[(*cell, back)] or (inside and steps[row, column, back]))


def of_floor(grid: GridMap) -> Lanes:
    """Return a floor as lanes: a node in the middle of each reachable cell, a lane for each legal step."""
    speed = grid.speed
    centres = grid.world(grid.centre(grid.free_cells)).round(6)
    names = {(r, c): f"r{r}c{c}" for r, c in grid.free_cells.tolist()}
    lanes = Lanes({name: (x, y) for name, (x, y) in zip(names.values(), centres.tolist(), strict=True)})
    for (row, column), name in names.items():
        for move, (d_row, d_column) in enumerate(STEPS):
            other = names.get((row + d_row, column + d_column))
            if other is not None and grid.legal_moves[row, column, 2 * move]:
                most = np.inf if speed is None else min(speed[row, column], speed[row + d_row, column + d_column])
                line = np.array([lanes.nodes[name], lanes.nodes[other]])
                price = 1.0 if grid.price is None else float(grid.price[row, column, 2 * move])
                lanes.lanes.append(Lane(f"{name}-{other}", name, other, line, float(most), price))
    for kind, cells in (("picks", grid.picks), ("stations", grid.stations)):
        lanes.places[kind] = tuple(Place(names[r, c], *lanes.nodes[names[r, c]]) for r, c in cells.tolist())
    return lanes
