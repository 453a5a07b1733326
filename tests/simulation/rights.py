"""Worlds in which a test decides on the right of way without a step: robots on straight routes across an open floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.simulation.reference import FRONT, LENGTH, OFFSET, REAR, WIDTH, Points
from tests.simulation.worlds import give_line, room, stage
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.traffic import local_activation, reservations, right_of_way, waits
from warehouse_env.simulation.traffic.path_ahead import CENTRE_X, COS, SIN
from warehouse_env.simulation.traffic.shield import NOBODY
from warehouse_env.traffic_spec import TRAFFIC, TrafficSpec

Pose = Sequence[float]
SPACING = 0.25  # [m] between a route's points


class World:
    """Robots at poses, each with a straight route ahead of it, and what has been decided last."""

    def __init__(
        self, *poses: Pose, ages: Sequence[int] | None = None, length: float = 8.0, grid: GridMap | None = None,
        people: int = 0,
    ) -> None:  # fmt: skip
        self.simulator = stage(
            room(24, 24) if grid is None else grid,
            *poses,
            action_type="discrete",
            action_repeat=2,
            traffic=TrafficSpec(shield=True, right_of_way=True),
            people=people,
        )
        self.robots = self.simulator.robots[0]
        self.robots["traffic"]["yields_to"] = self.robots["shield"]["vetoed_by"] = NOBODY
        self.robots["task"]["age"] = ages if ages is not None else 0
        for robot, (x, y, heading, *_) in enumerate(poses):
            along = np.arange(0.0, length + SPACING, SPACING)[:, None]
            points = np.array([x, y]) + along * [math.cos(heading), math.sin(heading)]
            give_line(self.simulator, robot, points)
        self.table: Any = None
        self.order = np.empty(len(poses), np.int64)

    def decide(self, actions: Any = None) -> World:
        """Grant paths; everybody cruises unless told otherwise."""
        sim = self.simulator
        told = np.full((1, len(self.robots)), int(sim.cruise_action)) if actions is None else actions
        sim.actions.decode(told, sim._commands[0], sim._choices)
        p, kinds = sim._params[0], sim._kinds
        self.table = reservations.ReservationTable(sim._paths[0], *reservations.scratch(len(self.robots)))
        self.activate_rules()
        right_of_way.rank(self.robots, self.order)
        who, what = (self.robots, sim.people.persons[0]), (sim.routes[0], sim.arcs[0], sim._commands[0, 0])
        world = right_of_way.Claims(*who, *what, sim._choices[0], self.table)
        right_of_way.decide(world, self.order, p, kinds, sim._floor)
        return self

    def activate_rules(self) -> bool:
        """Say who is settled; whether anybody is."""
        sim, found = self.simulator, waits.scratch(len(self.robots))
        commands, persons = sim._commands[0, 0], sim.people.persons[0]
        return bool(
            local_activation.activate_rules(self.robots, persons, sim.routes[0], commands, found, sim._params[0], None)
        )

    def granted(self, robot: int) -> int:
        """Number of the last pose that a robot has been granted."""
        return int(self.table.numbers[reservations.GRANT, robot])

    def path(self, robot: int, last: int | None = None) -> NDArray[np.float32]:
        """The poses of a robot's path, to the last one of it or to number `last`."""
        end = int(self.table.numbers[reservations.COUNT, robot]) if last is None else last + 1
        return np.array(self.table.paths[robot, :end])

    def drive(self, robot: int, pose: int) -> None:
        """Put a robot on a pose of its path."""
        path, r = self.path(robot), self.robots[robot]
        x, _, c, s, driven = path[pose]
        r["motion"]["x"], r["motion"]["y"] = x + OFFSET * c, path[pose, 1] + OFFSET * s
        r["motion"]["cos"], r["motion"]["sin"], r["motion"]["heading"] = c, s, math.atan2(s, c)
        r["totals"]["distance"] += float(driven)
        start = self.simulator.routes[0, robot, :2].astype(float)
        ahead = (start[1] - start[0]) / SPACING
        r["on_route"]["position"] = max(float((np.array([r["motion"]["x"], r["motion"]["y"]]) - start[0]) @ ahead), 0.0)


def rectangles(path: NDArray[np.float32], room: float = 0.0) -> Points:
    """Corners [K, 4, 2] of a path's bodies with `room` [m] around each."""
    path = path.astype(np.float64)
    centre, ahead = path[:, CENTRE_X : CENTRE_X + 2], path[:, COS : SIN + 1]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    assert math.isclose(FRONT + REAR, LENGTH)
    along = (LENGTH / 2 + room) * np.array([1, -1, -1, 1])[:, None]
    aside = (WIDTH / 2 + room) * np.array([1, 1, -1, -1])[:, None]
    return np.asarray(centre[:, None] + along * ahead[:, None] + aside * left[:, None])


def simulator_with_right(robots: int, layout: str, max_steps: int = 1000, **switches: Any) -> Simulator:
    """A simulator under the rules, but for some switches of TrafficSpec, which has not been reset."""
    from warehouse_env.config import EnvConfig

    traffic = replace(TRAFFIC["rules"], **switches)
    shared = {"planner": "astar_turns", "max_steps": max_steps, "action_repeat": 2, "traffic": traffic}
    return Simulator(EnvConfig(layout, robots, **shared))  # type: ignore[arg-type]
