"""Changes at the bottlenecks of a floor, opened aisles and one-way rules: raced, and the best measured on new seeds.

Pick faces and stations stay, so robots have the same tasks on every changed floor.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice.study import FEWEST, Team, TrialRuns, best_of, race
from train.advice.trials import AdvicePlan, Use
from train.advice.trips import Bottleneck, Trip, expected_cost
from train.reporting.columns import difference_of
from train.reporting.rows import Interval, mean_interval
from warehouse_env.maps.endpoints import beside, shelves
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.moves import label_regions

Kind = Literal["aisle", "one-way"]
REACH = 4  # [cells] from a bottleneck to a shelf that may be opened
MOST_CELLS = 60  # of shelf that one change removes
WIDEST = 2  # [cells] across an aisle
SHORTEST = 4  # [cells] along it
EAST, NORTH, WEST, SOUTH = 1, 2, 3, 4  # one_way.ARROWS
_NAMES = {EAST: "east", NORTH: "north", WEST: "west", SOUTH: "south"}
_STEPS = ((0, 1), (-1, 0), (0, -1), (1, 0))


class Candidate(NamedTuple):
    """A changed floor."""

    kind: Kind
    text: str  # the change in words
    grid: GridMap
    changed: NDArray[np.bool_]  # [H, W], cells opened or given a direction


class Storage(NamedTuple):
    """The storage that a change removes."""

    cells: int  # of shelf
    share: float  # of all shelf cells
    faces: int  # pick faces left without a shelf
    of: int  # pick faces with a shelf before


def storage_lost(grid: GridMap, one: Candidate) -> Storage:
    """Return the shelves, not walls, that are lost."""
    before, after = shelves(grid.walls), shelves(grid.walls) & ~one.changed
    served, left = (int(beside(racks)[tuple(grid.picks.T)].sum()) for racks in (before, after))
    cells = int(before.sum() - after.sum())
    return Storage(cells, cells / max(1, int(before.sum())), served - left, served)


def aisles(grid: GridMap, cell: Cell) -> list[Candidate]:
    """Return the aisles that can be opened around a cell, on each side with shelves; walls around the floor stay.

    Either a gap through the next rack, or its row of shelves that faces the cell; and each of them through all racks
    in that line.
    """
    racks, found = shelves(grid.walls), []
    for step in _STEPS:
        face = _nearest_face(~grid.occupied, racks, cell, step)
        if face is None:
            continue
        along_row = step[0] == 0
        through, across = (run == run[face] for run in (_runs(racks, along_row), _runs(racks, not along_row)))
        cells = np.argwhere(through)
        row, column = (cells[np.argmax(cells @ step)] + step).tolist()
        if _holds(~grid.occupied, (row, column)):
            found.append(_opened(grid, through, "a gap through the shelves"))
            found.append(_opened(grid, _line(racks, face, along_row), "a new aisle"))
        found.append(_opened(grid, across, "the aisle wider by a row of shelves"))
        found.append(_opened(grid, _line(racks, face, not along_row), "the aisle wider over its whole length"))
    return [one for one in found if one.changed.sum() <= MOST_CELLS]


def _nearest_face(free: NDArray[np.bool_], racks: NDArray[np.bool_], cell: Cell, step: Cell) -> Cell | None:
    """Return the first cell of a rack in that direction from a cell, or from the nearest free cell sideways of it."""
    sides = {(step[1], step[0]), (-step[1], -step[0])}
    for distance in range(REACH + 1):
        for aside in sorted(sides):
            start = (cell[0] + distance * aside[0], cell[1] + distance * aside[1])
            if not _holds(free, start):
                sides.remove(aside)
                continue
            ray = [(start[0] + k * step[0], start[1] + k * step[1]) for k in range(1, REACH + 1)]
            ahead = next((one for one in ray if not _holds(free, one)), None)
            if ahead is not None and _holds(racks, ahead):
                return ahead
    return None


def _holds(mask: NDArray[np.bool_], cell: Cell) -> bool:
    """Return whether a cell is marked; none is off the floor."""
    row, column = cell
    return 0 <= row < mask.shape[0] and 0 <= column < mask.shape[1] and bool(mask[cell])


def _line(racks: NDArray[np.bool_], cell: Cell, along_row: bool) -> NDArray[np.bool_]:
    """Return the cells of racks in a cell's row, or column."""
    line = np.zeros_like(racks)
    line[cell[0] if along_row else slice(None), slice(None) if along_row else cell[1]] = True
    return line & racks


def _opened(grid: GridMap, changed: NDArray[np.bool_], what: str) -> Candidate:
    text = f"{what} at {_where(grid, changed)} ({int(changed.sum())} shelf cells)"
    return Candidate("aisle", text, dataclasses.replace(grid, occupied=grid.occupied & ~changed), changed)


def _where(grid: GridMap, changed: NDArray[np.bool_]) -> str:
    """Say where cells are, in metres."""
    corners = grid.world(grid.centre(np.argwhere(changed)))
    half = grid.cell_size / 2
    (left, low), (right, high) = corners.min(axis=0) - half, corners.max(axis=0) + half
    return f"x {left:g} to {right:g} m, y {low:g} to {high:g} m"


def aisle_cells(grid: GridMap, along_row: bool) -> NDArray[np.int64]:
    """Return int64[H, W]: numbers from 1 for the aisles along rows (or columns), 0 off them.

    An aisle is at most WIDEST cells across, its sides shelves or the map's edge, and at least SHORTEST long.
    """
    free = ~grid.occupied if along_row else ~grid.occupied.T
    narrow = free & (run_lengths(free.T).T <= WIDEST)
    label = label_regions(narrow & (run_lengths(narrow) >= SHORTEST))
    return np.asarray(label if along_row else label.T, np.int64)


def _runs(marked: NDArray[np.bool_], along_row: bool) -> NDArray[np.int64]:
    """Return int64[H, W]: numbers from 1 for the runs of marked cells in rows (or columns), 0 off them."""
    from scipy.ndimage import label  # not when this is loaded, which takes long

    beside = np.zeros((3, 3), np.int64)
    beside[1] = 1
    return np.asarray(label(marked, beside if along_row else beside.T)[0], np.int64)


def run_lengths(free: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return int64[H, W]: the length of the run of free cells in its row that a cell is in, 0 off them."""
    runs = _runs(free, along_row=True)
    return np.where(free, np.bincount(runs.ravel())[runs], 0)


def one_ways(grid: GridMap, cell: Cell, flow: NDArray[np.float64]) -> list[Candidate]:
    """Return the aisles through a cell as one-way streets in the busier direction; flow: moves of RouteTraffic."""
    found = []
    for along_row in (True, False):
        label = aisle_cells(grid, along_row)
        if label[cell]:
            street = label == label[cell]
            forth, back = (EAST, WEST) if along_row else (NORTH, SOUTH)
            more = _towards(flow[street], forth) >= _towards(flow[street], back)
            way = forth if more else back
            text = f"one way {_NAMES[way]} at {_where(grid, street)}"
            found.append(_directed(grid, street, np.full(grid.shape, way), text))
    return [one for one in found if cut_off(one.grid) is None]


def _directed(grid: GridMap, street: NDArray[np.bool_], ways: NDArray[Any], text: str) -> Candidate:
    """Return the floor with a one-way street bool[H, W], by directions [H, W]."""
    directions = np.where(street, ways, grid.one_way).astype(grid.one_way.dtype)
    return Candidate("one-way", text, dataclasses.replace(grid, one_way=directions), street)


def _towards(flow: NDArray[np.float64], way: int) -> float:
    """Return how much of flow [K, 8] goes in a direction, also diagonally."""
    middle = 2 * (way - 1)
    return float(sum(flow[:, (middle + turn) % 8].sum() for turn in (-1, 0, 1)))


def cut_off(grid: GridMap) -> Cell | None:
    """Return an endpoint without a way to and from the first one, None if all are connected."""
    first, *others = grid.endpoints[2]
    region = grid.return_region(first)
    return next((cell for cell in others if not region[cell]), None)


def choose(candidates: Sequence[Candidate], trips: Sequence[Trip], robots: int, most: int) -> list[Candidate]:
    """Return the `most` different changes with the least expected cost of trips."""
    different = {one.changed.tobytes() + one.grid.one_way.tobytes(): one for one in reversed(candidates)}
    return sorted(different.values(), key=lambda one: expected_cost(one.grid, trips, robots))[:most]


KINDS: tuple[Kind, ...] = ("aisle", "one-way")
SOUGHT = 6  # changes of each kind that are raced, at most
CHOSEN_AT = 3  # bottlenecks at which changes are sought
ROUNDS = 6  # of the race, at most
PAIRS = 8  # of episodes, from which on a gain is reported
MOST_PAIRS = 64


class Effect(NamedTuple):
    """What a change of the floor gains, in pairs of episodes with the same seeds."""

    candidate: Candidate
    tried: int  # changes of its kind, of which it was the best
    base: Interval  # goals, or orders, per hour of all robots on the floor as it is
    gain: Interval  # difference; all gains of an advice together hold with 95%

    @property
    def significant(self) -> bool:
        """Whether there are enough pairs, and the interval excludes 0."""
        return self.gain.samples >= PAIRS and not self.gain.low <= 0 <= self.gain.high


def options(
    plan: AdvicePlan, worst: Sequence[Bottleneck], trips: Sequence[Trip], moves: NDArray[np.float64], robots: int,
    most: int,
) -> list[Candidate]:  # fmt: skip
    """Return up to `most` changes of each kind at the worst places; moves: see RouteTraffic."""
    if not most:
        return []
    cells = [place.cell for place in worst[:CHOSEN_AT]]
    opened = [one for cell in cells for one in aisles(plan.grid, cell)]
    directed = [one for cell in cells for one in one_ways(plan.grid, cell, moves)]
    return [one for kind in (opened, directed) for one in choose(kind, trips, robots, most)]


def affordable(left: float, took: float) -> int:
    """Return how many changes of each kind can be raced in the seconds left, 0 to SOUGHT.

    The best of each and the floor as it is are then driven PAIRS times. took: of an episode.
    """
    episodes = min(left / max(took, 1e-9), 1e9) - PAIRS * (1 + len(KINDS))
    return 0 if episodes < 0 else int(min(SOUGHT, max(1, (episodes / FEWEST - 1) // len(KINDS))))


def effects(study: TrialRuns, chosen: Sequence[Candidate], team: Team) -> list[Effect]:
    """Race the changes of each kind, and measure the best of each on new seeds."""
    kinds = [own for kind in KINDS if (own := [one for one in chosen if one.kind == kind])]
    if not kinds:
        return []
    aim, robots = study.plan.aim, team.robots
    study.floors |= {one.text: one.grid for one in chosen}
    measured = [_best_of(study, own, team) for own in kinds]
    base, *gained = study.repeat(
        [team, *(team._replace(floor=one.text) for one in measured)], Use.MEASURE, MOST_PAIRS, 1.0
    )
    whole = mean_interval(map(aim.gain, base)).times(robots)
    sure = 1 - 0.05 / len(measured)
    return [
        Effect(one, len(own), whole, difference_of(rows, base, aim.gain, ("seed",), sure).times(robots))
        for one, own, rows in zip(measured, kinds, gained, strict=True)
    ]


def _best_of(study: TrialRuns, changes: Sequence[Candidate], team: Team) -> Candidate:
    """Race changes; return the best."""
    gain, changed = study.plan.aim.gain, {team._replace(floor=one.text): one for one in changes}

    def play(left: Sequence[Team], number: int) -> list[float]:
        (base,), *rows = study.rows([team, *left], study.plan.seeds(Use.LOOK, 1, number))
        return [gain(row) - gain(base) for (row,) in rows]

    def goes_on(left: Sequence[Team], number: int) -> bool:
        seeds, reserve = study.plan.seeds(Use.LOOK, 1, number), PAIRS * (1 + len(KINDS)) * study.seconds(team.robots)
        return len(left) > 1 and (number < FEWEST or study.affords([team, *left], seeds, 1.0, reserve))

    return changed[best_of(race(changed, play, study.plan.at_most(ROUNDS), goes_on))]
