"""Stations and chargers: a floor with one more or one fewer, to be driven beside the floor as it is."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
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

FEWER: tuple[Kind, ...] = ("station fewer", "charger fewer")  # kinds that may cost, and bring nothing by themselves
SITES = 24  # of one station more, and of one fewer, that are thought of


def kinds(work: Mapping[str, Any]) -> tuple[Kind, ...]:
    """Return the kinds of changes that work asks for: stations where it takes time at them, chargers with batteries.

    Orders of a file name their stations, so these stay.
    """
    drawn = "orders" not in work or work["orders"].file is None
    stations: tuple[Kind, ...] = ("station more", "station fewer") if "service" in work and drawn else ()
    chargers: tuple[Kind, ...] = ("charger more", "charger fewer") if "battery" in work else ()
    return stations + chargers


def options(plan: Plan, crew: Crew, most: int) -> list[Candidate]:
    """Return the changes of each kind that the crew can drive with, up to `most`, those of the cheapest trips first."""
    found = {
        "station more": _stations_more(plan, crew), "station fewer": _stations_fewer(plan.grid),
        "charger more": _chargers(plan, 1), "charger fewer": _chargers(plan, -1),
    }  # fmt: skip
    return [one for kind in kinds(plan.work) for one in _cheapest(found[kind], plan, crew, most)]


def _cheapest(candidates: Iterable[Candidate], plan: Plan, crew: Crew, most: int) -> list[Candidate]:
    """Return the `most` candidates by which trips between their own endpoints should cost least."""
    possible = [one for one in candidates if _drives(one, plan, crew)] if most else []
    if len(possible) < 2:
        return possible

    def cost(one: Candidate) -> float:
        return expected_cost(one.grid, draw_trips(one.grid, plan.seed), crew.robots)

    return sorted(possible, key=cost)[:most]


def _stations_more(plan: Plan, crew: Crew) -> Iterator[Candidate]:
    """Yield floors with one station more, beside the traffic, and so far from the others that robots can pass."""
    grid = plan.grid
    config = EnvConfig(num_agents=crew.robots, **plan.work)
    sites = [cell for cell in standing_places(grid, config, len(grid.free_cells)) if _is_apart(cell, grid)]
    for cell in _spread(sites):
        yield _with_stations(grid, [*grid.endpoints[1], cell], cell, "station more")


def _spread(cells: list[Cell]) -> list[Cell]:
    """Return up to SITES of the cells, evenly."""
    return cells[:: max(1, -(-len(cells) // SITES))]


def _is_apart(cell: Cell, grid: GridMap) -> bool:
    return int(np.abs(grid.stations - cell).max(axis=1).min()) >= STATION_SPACING


def _stations_fewer(grid: GridMap) -> Iterator[Candidate]:
    """Yield floors with one station fewer."""
    stations = grid.endpoints[1]
    for cell in _spread(stations) if len(stations) > 1 else ():
        yield _with_stations(grid, [one for one in stations if one != cell], cell, "station fewer")


def _with_stations(grid: GridMap, stations: list[Cell], cell: Cell, kind: Kind) -> Candidate:
    changed = np.zeros(grid.shape, dtype=np.bool_)
    changed[cell] = True
    x, y = grid.centre(cell).tolist()
    text = f"{'a station more' if kind == 'station more' else 'no station'} at x {x:g} m, y {y:g} m"
    return Candidate(kind, text, dataclasses.replace(grid, stations=np.array(stations)), changed)


def _chargers(plan: Plan, step: int) -> Iterator[Candidate]:
    """Yield the floor with so many chargers more; where they stand is chosen anew."""
    battery = plan.work.get("battery")
    if battery is not None and battery.chargers + step >= 1:
        count = battery.chargers + step
        kind: Kind = "charger more" if step > 0 else "charger fewer"
        work = {"battery": dataclasses.replace(battery, chargers=count)}
        text = f"{count} charger{'s' * (count > 1)} instead of {battery.chargers}"
        yield Candidate(kind, text, plan.grid, np.zeros(plan.grid.shape, dtype=np.bool_), work)


def _drives(one: Candidate, plan: Plan, crew: Crew) -> bool:
    """Return whether the crew can be set to work on a changed floor."""
    env, work = EnvConfig(num_agents=crew.robots, planner=plan.planner), {**plan.work, **one.work}
    try:
        simulator_of(make_experiment(crew.policy, env, 1, plan.seconds, plan.seed, work).config, 1, one.grid)
    except WarehouseError:
        return False
    return True
