"""Stations and chargers: floors with other numbers of them, a ladder of each, driven beside the floor as it is."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from train.advice.candidates import Candidate, Kind, draw_trips, expected_cost
from train.advice.study import Crew
from train.advice.trials import Plan
from train.books import simulator_of
from train.evaluation.rollout import make_experiment
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.endpoints import STATION_SPACING
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.simulation.tasks.places import standing_places

RUNGS = 5  # of a ladder
SITES = 24  # of stations, more or fewer, that are compared


def kinds(work: Mapping[str, Any]) -> tuple[Kind, ...]:
    """Return the ladders that work asks for: of stations where it takes time at them, of chargers with batteries.

    Orders of a file name their stations, so these stay.
    """
    drawn = "orders" not in work or work["orders"].file is None
    stations: tuple[Kind, ...] = ("stations",) if "service" in work and drawn else ()
    chargers: tuple[Kind, ...] = ("chargers",) if "battery" in work else ()
    return stations + chargers


def rungs(count: int) -> list[int]:
    """Return the numbers that are tried instead of `count`; those first that should be told apart soonest."""
    tried = (2 * count, count // 2, math.ceil(1.5 * count), count - 1, count + 1)
    return list(dict.fromkeys(number for number in tried if number >= 1 and number != count))


def options(plan: Plan, crew: Crew, most: int) -> list[Candidate]:
    """Return up to `most` rungs of each ladder that the crew can drive on, the fewest first."""
    found: list[Candidate] = []
    for kind in kinds(plan.work) if most else ():
        made = _stations(plan, crew, most) if kind == "stations" else _chargers(plan, most)
        found += sorted((one for one in made if _drives(one, plan, crew)), key=lambda one: one.number)
    return found


def _stations(plan: Plan, crew: Crew, most: int) -> Iterator[Candidate]:
    """Yield floors with other numbers of stations: the best sites first, and those go first that are missed least."""
    grid = plan.grid
    now = grid.endpoints[1]
    numbers = rungs(len(now))[:most]
    spare = now if min(numbers, default=len(now)) >= len(now) else _by_cost(plan, crew, now, fewer=True)
    sites = _by_cost(plan, crew, _sites(plan, crew), fewer=False) if max(numbers, default=0) > len(now) else []
    for number in numbers:
        step = number - len(now)
        changed = sites[:step] if step > 0 else spare[:-step]
        if len(changed) < abs(step):
            continue
        left = [*now, *changed] if step > 0 else [one for one in now if one not in changed]
        yield _with_stations(grid, left, changed)


def _sites(plan: Plan, crew: Crew) -> list[Cell]:
    """Return where stations can be added, beside the traffic, so far from all others that robots can pass."""
    config = EnvConfig(num_agents=crew.robots, **plan.given(crew.robots))
    taken = list(plan.grid.endpoints[1])
    found: list[Cell] = []
    for cell in standing_places(plan.grid, config, len(plan.grid.free_cells)):
        if all(max(abs(cell[0] - row), abs(cell[1] - column)) >= STATION_SPACING for row, column in taken):
            found.append(cell)
            taken.append(cell)
    return found


def _by_cost(plan: Plan, crew: Crew, cells: Sequence[Cell], fewer: bool) -> list[Cell]:
    """Return cells by what trips should cost if each alone were added, or taken away; of many, SITES are compared."""
    if len(cells) < 2:
        return list(cells)
    now = plan.grid.endpoints[1]
    compared = cells[:: -(-len(cells) // SITES)]

    def cost(cell: Cell) -> float:
        stations = [one for one in now if one != cell] if fewer else [*now, cell]
        grid = dataclasses.replace(plan.grid, stations=np.array(stations))
        return expected_cost(grid, draw_trips(grid, plan.seed), crew.robots)

    first = sorted(compared, key=cost) if not fewer or len(now) > 1 else list(compared)
    return [*first, *(cell for cell in cells if cell not in first)]


def _with_stations(grid: GridMap, stations: Sequence[Cell], moved: Sequence[Cell]) -> Candidate:
    changed = np.zeros(grid.shape, dtype=np.bool_)
    changed[tuple(np.array(moved).T)] = True
    before = len(grid.endpoints[1])
    text = f"{_counted(len(stations), 'station')} instead of {before}"
    if len(moved) == 1:
        x, y = grid.world(grid.centre(moved[0])).tolist()
        text += f", {'one more' if len(stations) > before else 'without that'} at x {x:g} m, y {y:g} m"
    floor = dataclasses.replace(grid, stations=np.array(stations))
    return Candidate("stations", text, floor, changed, number=len(stations), before=before)


def _chargers(plan: Plan, most: int) -> Iterator[Candidate]:
    """Yield the floor with other numbers of chargers; where they stand is chosen anew."""
    battery = plan.work["battery"]
    for number in rungs(battery.chargers)[:most]:
        work = {"battery": dataclasses.replace(battery, chargers=number)}
        text = f"{_counted(number, 'charger')} instead of {battery.chargers}"
        nothing = np.zeros(plan.grid.shape, dtype=np.bool_)
        yield Candidate("chargers", text, plan.grid, nothing, work, number, battery.chargers)


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count > 1)}"


def _drives(one: Candidate, plan: Plan, crew: Crew) -> bool:
    """Return whether the crew can be set to work on a changed floor."""
    env, work = EnvConfig(num_agents=crew.robots, planner=plan.planner), {**plan.given(crew.robots), **one.work}
    try:
        simulator_of(make_experiment(crew.policy, env, 1, plan.seconds, plan.seed, work).config, 1, one.grid)
    except WarehouseError:
        return False
    return True
