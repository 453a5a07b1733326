"""Small simulators whose robots stand where a test puts them."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tests.simulation.reference import FRONT, LENGTH, WIDTH
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.routes.route_table import Route
from warehouse_env.simulation.physics.geometry import Rectangle
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import NOBODY, OWNER

ROOT = Path(__file__).parents[2]
Pose = Sequence[float]  # x [m], y [m], heading [rad], then speed [m/s] and steering [rad] if not 0


def drawn(lines: Sequence[str], cell: float = 1.0) -> GridMap:
    """A map from lines of `#` (shelf) and `.`; every second free cell is a pick, the others are stations."""
    occupied = np.array([[mark == "#" for mark in line] for line in lines])
    free = np.argwhere(~occupied)
    return GridMap(occupied, cell_size=cell, picks=free[::2], stations=free[1::2], name="drawn")


def room(rows: int, columns: int) -> GridMap:
    """An empty floor."""
    return drawn(["." * columns] * rows)


def give_line(simulator: Simulator, robot: int, line: ArrayLike) -> None:
    """Give a robot of world 0 an evenly spaced line [R, 2] [m] as its route."""
    points = np.asarray(line, np.float32)
    cells = simulator.grid.nearest_cell(points).astype(np.int32)
    simulator.dispatcher.give_route(0, robot, Route(cells, points))


def put(simulator: Simulator, robot: int, pose: Pose, world: int = 0) -> None:
    """Stand a robot at a pose, in float32 as the simulator would."""
    r = simulator.robots[world, robot]
    x, y, heading, *motion = (float(np.float32(value)) for value in pose)
    r["motion"]["x"], r["motion"]["y"], r["motion"]["heading"] = x, y, heading
    r["motion"]["cos"], r["motion"]["sin"] = math.cos(heading), math.sin(heading)
    r["motion"]["speed"], r["motion"]["steer"] = (*motion, 0.0, 0.0)[:2]


def stage(grid: GridMap, *poses: Pose, **changes: Any) -> Simulator:
    """One world with a robot at each pose; raw actions and one physics step an env step unless changed."""
    settings = {"action_type": "raw", "action_repeat": 1, "planner": "astar", "max_steps": 10**6} | changes
    config = EnvConfig(num_agents=len(poses), **settings)
    simulator = Simulator(config, grid=grid)
    simulator.robots["task"]["alive"] = 1
    simulator.robots["events"]["gap"] = simulator.robots["totals"]["min_gap"] = 0.5
    simulator.robots["shield"]["vetoed_by"] = simulator.robots["traffic"]["yields_to"] = NOBODY
    for robot, pose in enumerate(poses):
        put(simulator, robot, pose)
        write(simulator.robots[0, robot], goal_x=-1e3, goal_y=-1e3)  # nobody arrives
    return simulator


def write(r: Any, **fields: Any) -> None:
    """Write fields of a robot's record, or of several."""
    for name, value in fields.items():
        r[OWNER[name]][name] = value


def lay(simulator: Simulator, *corners: tuple[float, float], robot: int = 0) -> None:
    """Lay a robot's route along straight lines between corners, points 0.5 m apart, up to its goal."""
    points = [corners[0]]
    for (ax, ay), (bx, by) in pairwise(corners):
        count = round(math.hypot(bx - ax, by - ay) / 0.5)
        points += [(ax + (bx - ax) * k / count, ay + (by - ay) * k / count) for k in range(1, count + 1)]
    simulator.routes[0, robot, : len(points)] = points
    (x, y), (row, column) = points[-1], simulator.grid.cell(points[-1])
    goal = {"goal_x": x, "goal_y": y, "goal_row": row, "goal_col": column}
    write(simulator.robots[0, robot], points=len(points), spacing=0.5, **goal)


def body_at(
    x: float, y: float, heading: float, length: float = LENGTH, width: float = WIDTH, front: float = FRONT
) -> Rectangle:
    """The simulator's rectangle of a robot whose front axle is at (x, y), rounded to float32."""
    c, s, back = math.cos(heading), math.sin(heading), length / 2 - front
    return Rectangle(*map(np.float32, (x - back * c, y - back * s, c, s, length / 2, width / 2)))


def raw(simulator: Simulator, *commands: tuple[float, float]) -> NDArray[np.float32]:
    """Raw actions [1, N, 2] from (acceleration [m/s^2], steering rate [rad/s]) of each robot."""
    robot = simulator.config.robot
    limits = (robot.max_acceleration, robot.max_steering_rate)
    return (np.array([commands]) / limits).astype(np.float32)


def coast(simulator: Simulator, steps: int) -> None:
    """Step with no acceleration and no steering."""
    still = np.zeros((simulator.num_worlds, simulator.num_agents, 2), dtype=np.float32)
    for _ in range(steps):
        simulator.step(still)


def plain_python(program: str) -> list[str]:
    """Run a program without the compiler, and return the words that it prints."""
    command, environment = [sys.executable, "-W", "ignore", "-c", program], os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()
