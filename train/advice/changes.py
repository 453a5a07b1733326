"""Aisles that can be opened at the bottlenecks of a floor: raced, and the best measured on new seeds.

Pick faces and stations stay, so robots have the same tasks on every changed floor.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice.study import FEWEST, Team, TrialRuns, best_of, race
from train.advice.trials import AdvicePlan, Use
from train.advice.trips import Bottleneck, Trip, expected_cost
from train.reporting.columns import difference_of
from train.reporting.rows import Interval, mean_interval
from warehouse_env.maps.endpoints import beside, shelves
from warehouse_env.maps.grid_map import Cell, GridMap

REACH = 4  # [cells] from a bottleneck to a shelf that may be opened
MOST_CELLS = 60  # of shelf that one change removes
_STEPS = ((0, 1), (-1, 0), (0, -1), (1, 0))


class Candidate(NamedTuple):
    """A changed floor."""

    text: str  # the change in words
    grid: GridMap
    opened: NDArray[np.bool_]  # [H, W], cells of shelf that become floor


def storage_lost(grid: GridMap, one: Candidate) -> tuple[int, float, int, int]:
    """Return the lost shelf cells, not walls, their share, the pick faces left without a shelf, and of how many."""
    before, after = shelves(grid.walls), shelves(grid.walls) & ~one.opened
    served, left = (int(beside(racks)[tuple(grid.picks.T)].sum()) for racks in (before, after))
    cells = int(before.sum() - after.sum())
    return cells, cells / max(1, int(before.sum())), served - left, served


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
        through, across = (run == run[face] for run in (runs(racks, along_row), runs(racks, not along_row)))
        cells = np.argwhere(through)
        row, column = (cells[np.argmax(cells @ step)] + step).tolist()
        if _holds(~grid.occupied, (row, column)):
            found.append(_opened(grid, through, "a gap through the shelves"))
            found.append(_opened(grid, _line(racks, face, along_row), "a new aisle"))
        found.append(_opened(grid, across, "the aisle wider by a row of shelves"))
        found.append(_opened(grid, _line(racks, face, not along_row), "the aisle wider over its whole length"))
    return [one for one in found if one.opened.sum() <= MOST_CELLS]


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


def _opened(grid: GridMap, cells: NDArray[np.bool_], what: str) -> Candidate:
    centres, half = grid.centre(np.argwhere(cells)), grid.cell_size / 2
    (left, low), (right, high) = grid.world([centres.min(axis=0) - half, centres.max(axis=0) + half])
    where = f"x {left:g} to {right:g} m, y {low:g} to {high:g} m"
    text = f"{what} at {where} ({int(cells.sum())} shelf cells)"
    return Candidate(text, dataclasses.replace(grid, occupied=grid.occupied & ~cells), cells)


def runs(marked: NDArray[np.bool_], along_row: bool) -> NDArray[np.int64]:
    """Return int64[H, W]: numbers from 1 for the runs of marked cells in rows (or columns), 0 off them."""
    from scipy.ndimage import label  # not when this is loaded, which takes long

    beside = np.zeros((3, 3), np.int64)
    beside[1] = 1
    return np.asarray(label(marked, beside if along_row else beside.T)[0], np.int64)


def choose(candidates: Sequence[Candidate], trips: Sequence[Trip], robots: int, most: int) -> list[Candidate]:
    """Return the `most` different changes with the least expected cost of trips."""
    different = {one.opened.tobytes(): one for one in reversed(candidates)}
    return sorted(different.values(), key=lambda one: expected_cost(one.grid, trips, robots))[:most]


SOUGHT = 6  # changes that are raced, at most
CHOSEN_AT = 3  # bottlenecks at which changes are sought
ROUNDS = 6  # of the race, at most
PAIRS = 8  # of episodes at least for a gain to be reported
_DRIVEN = 2 * PAIRS  # episodes for that: of the best change, and of the floor as it is
MOST_PAIRS = 64


class Effect(NamedTuple):
    """What a change of the floor gains, in pairs of episodes with the same seeds."""

    candidate: Candidate
    tried: int  # number of changes, the best of which this is
    base: Interval  # goals, or orders, per hour of all robots on the floor as it is
    gain: Interval  # difference

    @property
    def significant(self) -> bool:
        """Whether there are enough pairs, and the interval excludes 0."""
        return self.gain.samples >= PAIRS and not self.gain.low <= 0 <= self.gain.high


def options(
    plan: AdvicePlan, worst: Sequence[Bottleneck], trips: Sequence[Trip], robots: int, most: int
) -> list[Candidate]:
    """Return up to `most` changes at the worst places."""
    if not most:
        return []
    return choose([one for place in worst[:CHOSEN_AT] for one in aisles(plan.grid, place.cell)], trips, robots, most)


def affordable(left: float, took: float) -> int:
    """Return how many changes can be raced in the seconds left, 0 to SOUGHT.

    The best and the floor as it is are then driven PAIRS times. took: of an episode.
    """
    episodes = min(left / max(took, 1e-9), 1e9) - _DRIVEN
    return 0 if episodes < 0 else int(min(SOUGHT, max(1, episodes / FEWEST - 1)))


def measured(study: TrialRuns, chosen: Sequence[Candidate], team: Team) -> Effect | None:
    """Race changes, and measure the best on new seeds; None without any."""
    if not chosen:
        return None
    study.floors |= {one.text: one.grid for one in chosen}
    aim, best = study.plan.aim, _best_of(study, chosen, team)
    base, rows = study.repeat([team, team._replace(floor=best.text)], Use.MEASURE, MOST_PAIRS, 1.0)
    made = mean_interval(map(aim.gain, base)).times(team.robots)
    gain = difference_of(rows, base, aim.gain, ("seed",)).times(team.robots)
    return Effect(best, len(chosen), made, gain)


def _best_of(study: TrialRuns, changes: Sequence[Candidate], team: Team) -> Candidate:
    """Race changes; return the best."""
    gain, changed = study.plan.aim.gain, {team._replace(floor=one.text): one for one in changes}

    def play(left: Sequence[Team], number: int) -> list[float]:
        (base,), *rows = study.rows([team, *left], study.plan.seeds(Use.LOOK, 1, number))
        return [gain(row) - gain(base) for (row,) in rows]

    def goes_on(left: Sequence[Team], number: int) -> bool:
        seeds, reserve = study.plan.seeds(Use.LOOK, 1, number), _DRIVEN * study.seconds(team.robots)
        return len(left) > 1 and (number < FEWEST or study.affords([team, *left], seeds, 1.0, reserve))

    return changed[best_of(race(changed, play, study.plan.at_most(ROUNDS), goes_on))]
