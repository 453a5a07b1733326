"""Floors with one station or charger more or fewer, driven beside the floor as it is."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from train.advice.candidates import Candidate, Kind, draw_trips, expected_cost
from train.advice.study import Team
from train.advice.trials import AdvicePlan
from train.books import simulator_of
from train.evaluation.rollout import make_experiment
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.endpoints import STATION_SPACING
from warehouse_env.maps.grid_map import Cell
from warehouse_env.simulation.tasks.places import standing_places

SITES = 24  # of a station, to add or to take away, that are compared


def kinds(work: Mapping[str, Any]) -> tuple[Kind, ...]:
    """Return what is varied: stations if service takes time, chargers if robots have batteries.

    Orders of a file name their stations, so those stay.
    """
    drawn = "orders" not in work or work["orders"].file is None
    stations: tuple[Kind, ...] = ("stations",) if "service" in work and drawn else ()
    return stations + (("chargers",) if "battery" in work else ())


def options(plan: AdvicePlan, crew: Team) -> list[Candidate]:
    """Return one more and one fewer of each kind, as far as the crew can drive there."""
    made = {"stations": _stations, "chargers": _chargers}
    return [one for kind in kinds(plan.work) for one in made[kind](plan, crew) if _drives(one, plan, crew)]


def _stations(plan: AdvicePlan, crew: Team) -> Iterator[Candidate]:
    """Yield the floor with a station at the best site, and without the one that is missed least."""
    now = list(plan.grid.endpoints[1])
    choices = [([*now, cell], cell) for cell in _some(_sites(plan, crew))]
    fewer = [([one for one in now if one != cell], cell) for cell in _some(now)] if len(now) > 1 else []
    for what, offered in (("one more station", choices), ("one station fewer", fewer)):
        floors = [(dataclasses.replace(plan.grid, stations=np.array(cells)), cell) for cells, cell in offered]
        if not floors:
            continue
        grid, cell = min(
            floors, key=lambda floor: expected_cost(floor[0], draw_trips(floor[0], plan.seed), crew.robots)
        )
        changed = np.zeros(grid.shape, dtype=np.bool_)
        changed[cell] = True
        x, y = grid.world(grid.centre(cell)).tolist()
        text = f"{what} at x {x:g} m, y {y:g} m ({len(grid.endpoints[1])} instead of {len(now)})"
        yield Candidate("stations", text, grid, changed)


def _some(cells: Sequence[Cell]) -> Sequence[Cell]:
    """Return up to SITES of many cells, evenly spread."""
    return cells[:: max(1, -(-len(cells) // SITES))]


def _sites(plan: AdvicePlan, crew: Team) -> list[Cell]:
    """Return where a station can be added, beside the traffic and apart from other stations."""
    config = EnvConfig(num_agents=crew.robots, **plan.given(crew.robots))
    now = plan.grid.endpoints[1]
    return [
        cell
        for cell in standing_places(plan.grid, config, len(plan.grid.free_cells))
        if all(max(abs(cell[0] - row), abs(cell[1] - column)) >= STATION_SPACING for row, column in now)
    ]


def _chargers(plan: AdvicePlan, crew: Team) -> Iterator[Candidate]:
    """Yield the floor with a charger more and one fewer; their places are chosen anew."""
    battery, nothing = plan.work["battery"], np.zeros(plan.grid.shape, dtype=np.bool_)
    for number, what in ((battery.chargers + 1, "one more charger"), (battery.chargers - 1, "one charger fewer")):
        if number:
            work = {"battery": dataclasses.replace(battery, chargers=number)}
            text = f"{what} ({number} instead of {battery.chargers})"
            yield Candidate("chargers", text, plan.grid, nothing, work)


def _drives(one: Candidate, plan: AdvicePlan, crew: Team) -> bool:
    """Return whether the crew can work on a changed floor."""
    env, work = EnvConfig(num_agents=crew.robots, planner=plan.planner), {**plan.given(crew.robots), **one.work}
    try:
        simulator_of(make_experiment(crew.policy, env, 1, plan.seconds, plan.seed, work).config, 1, one.grid)
    except WarehouseError:
        return False
    return True
