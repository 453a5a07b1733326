"""Paper 001's experiment with six AGVs: routes planned alone, driven alone, by its coordinator, and by real bodies.

On the grid a straight move or a wait takes 1 and a diagonal sqrt(2), a cell a second, as the paper counts it: its
"length" holds the waits. In the simulator lengths are metres driven and times are simulated seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from agents.rules import Rules
from train.books import simulator_of
from train.evaluation.rollout import make_experiment, play_out
from train.reporting.rows import Row
from train.tables.papers.coordinator import Coordinator, Driven, drive_alone, duration
from train.tables.study import System, TableTask
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Planner, min_turns, turns
from warehouse_env.routes.book import RouteBook
from warehouse_env.simulation.physics.floor import floor_of
from warehouse_env.simulation.state import ROBOT, parameters_of
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.tasks.placement import place
from warehouse_env.traffic.conflicts import Route

Task = tuple[Cell, Cell]

ALONE: Final = "alone"  # as if nobody else were there
BODIES_ALONE: Final = "bodies alone"  # each in a world of its own
BODIES: Final = "bodies"  # together, each with the policy `rules`
COORDINATORS: Final = {
    "coordinator": Coordinator(),
    "no step aside": Coordinator(aside=False),
    "no new route": Coordinator(new_route=False),
}
SECONDS = 300.0  # after which bodies that have not arrived are given up


class Outcome(NamedTuple):
    """length, last: of all together, and until the last has arrived; contacts: pairs that touched, or touches."""

    arrived: bool
    length: float
    last: float
    contacts: float


def drive_fleet(task: TableTask, system: System, rng: np.random.Generator) -> Row:
    """Plan all robots of a task alone, drive them as the system's mode says, and return the row's figures."""
    tasks, planner = ((task.start, task.goal), *task.others), system.make()
    routes = [planner.plan(task.grid, *one, rng).cells for one in tasks]
    found = all(map(len, routes))
    outcome = _drive(task.grid, tasks, routes, planner, system.mode) if found else Outcome(False, 0.0, 0.0, 0.0)
    optimum = sum(float(task.grid.distance_to(goal)[start]) for start, goal in tasks)
    done = outcome.arrived
    return {
        "success": done, "length": outcome.length if done else None, "last": outcome.last if done else None,
        "contacts": outcome.contacts, "optimal_length": optimum, "gap": outcome.length / optimum - 1 if done else None,
        "turns": sum(map(turns, routes)), "min_turns": sum(min_turns(task.grid, *one) for one in tasks),
    }  # fmt: skip


def _drive(grid: GridMap, tasks: Sequence[Task], routes: Sequence[Route], planner: Planner, mode: str) -> Outcome:
    if mode == ALONE:
        return _on_the_grid(drive_alone(routes))
    if mode in COORDINATORS:
        return _on_the_grid(COORDINATORS[mode].drive(grid, routes))
    return _bodies(grid, planner, [tasks] if mode == BODIES else [[one] for one in tasks])


def _on_the_grid(driven: Driven) -> Outcome:
    times = [duration(path) for path in driven.paths()]
    return Outcome(driven.arrived, sum(times), max(times), driven.clashes())


def _assignment(tasks: Sequence[Task], routes: RouteBook, config: EnvConfig) -> Assignment:
    """Return robots at the tasks' starts, each facing along its route as nearly as it fits there."""
    grid = routes.grid
    robots, parameters = np.zeros(len(tasks), ROBOT), parameters_of(config, grid.cell_size)
    for robot, (start, goal) in enumerate(tasks):
        line = routes.route(start, goal).line
        direction = line[min(2, len(line) - 1)] - line[0]
        if not place(robots, robot, grid.centre(start), direction, (parameters, None), floor_of(grid)):
            raise ConfigError(f"robot {robot} touches something at {start}; choose another start")
    pose = np.stack([robots["motion"][name].astype(np.float64) for name in ("x", "y", "heading")], axis=1)
    return Assignment(pose, np.array([goal for _, goal in tasks]))


def _bodies(grid: GridMap, planner: Planner, worlds: Sequence[Sequence[Task]]) -> Outcome:
    """Drive each world's robots until all have arrived or time is up."""
    env = EnvConfig(num_agents=len(worlds[0]), tasks="one_shot")
    experiment = make_experiment(Rules.name, env, len(worlds), SECONDS, 0)
    simulator = simulator_of(experiment.config, len(worlds), grid, planner)
    book = simulator.route_book
    simulator.reset_to([_assignment(tasks, book, experiment.config) for tasks in worlds], experiment.seeds)
    played, _ = play_out(experiment, simulator)
    return Outcome(
        all(one["success_rate"] == 1.0 for one in played),
        sum(one["path_length_m"] * one["goals"] for one in played if one["goals"]),
        max(one["makespan_s"] for one in played),
        sum(one["collisions_robot"] + one["collisions_shelf"] for one in played),
    )
