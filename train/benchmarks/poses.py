"""Does a robot alone reach any pose? From random poses to random poses, on every layout, with `arrival="pose"`.

A pose counts if the body keeps 3 cm off shelves there and a search of manoeuvres finds a way off it: ways lead both
ways, so what cannot be left cannot be reached. Times are held against Reeds-Shepp curves between the two poses, which
know of no shelves, at the least radius: of all words the one soonest driven with the robot's speeds and accelerations.
To drive it exactly, a robot stands wherever it turns back or the curvature jumps, and steers there; the other time is
that of a robot which steers in no time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from train.reporting.report import Table, number
from train.reporting.rows import Row
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.routes.reeds_shepp import TURNS, WORDS, seen_from, word
from warehouse_env.simulation.driver.bodies import SearchArea
from warehouse_env.simulation.driver.manoeuvre import ARCS, FAR_OFF, TRIES, Query, search
from warehouse_env.simulation.driver.scratch import MOST, make_search_scratch
from warehouse_env.simulation.driver.turning import turning_metric
from warehouse_env.simulation.physics.floor import floor_of
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import body_of, grown, pose_at
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import parameters_of
from warehouse_env.simulation.tasks.assignment import Assignment

MARGIN = 0.03  # [m] that a body keeps off shelves at a start and a goal
PATIENCE = 300.0  # [s] after which a robot counts as never arriving
NEAR, FAR = 1.0, 8.0  # [m] between start and goal of the pairs that are near each other
PLANNER = "astar_turns"
_STEER = 1e-6  # [rad] that count as no change of steering

Pose = tuple[float, float, float]


def poses(count: int, seed: int) -> Iterator[Row]:
    """Yield a row for every layout, of about `count` pairs of poses in all, and one of pairs near each other."""
    each = math.ceil(count / len(LAYOUTS))
    for layout in LAYOUTS:
        yield {"floor": layout, "near": False, **drive(make_layout(layout), each, seed)}
    yield {"floor": "open", "near": True, **drive(make_layout("open"), each, seed, FAR)}


def drive(grid: GridMap, pairs: int, seed: int, farthest: float = math.inf) -> Row:
    """Drive one robot from pose to pose in each of `pairs` worlds; farthest [m]: between the two."""
    config = EnvConfig(
        layout=grid.name, num_agents=1, planner=PLANNER, arrival="pose", tasks="one_shot", max_steps=10**6
    )
    sampler = _Sampler(grid, config, seed)
    ends = [sampler.pair(farthest) for _ in range(pairs)]
    simulator = Simulator(config, pairs, grid=grid)
    simulator.reset_to([Assignment(np.array([start]), np.array([goal])) for start, goal in ends], seed)
    cruise = np.full((pairs, 1), simulator.cruise_action)
    seconds = np.full(pairs, np.nan)
    while simulator.steps[0] * config.time_step < PATIENCE and np.isnan(seconds).any():
        simulator.step(cruise)
        for arrival in simulator.arrivals:
            seconds[arrival.world] = simulator.seconds(arrival.world)
    there = ~np.isnan(seconds)
    goals, robots = np.array([goal for _, goal in ends]), simulator.robots[:, 0]
    off = np.hypot(robots["motion"]["x"] - goals[:, 0], robots["motion"]["y"] - goals[:, 1])[there]
    turned = np.abs(np.remainder(robots["motion"]["heading"] - goals[:, 2] + math.pi, 2 * math.pi) - math.pi)[there]
    curves = [curve_seconds(start, goal, config.robot) for start, goal in ends]
    exact, free = (np.median((seconds / np.array(kind))[there]) for kind in zip(*curves, strict=True))
    return {
        "pairs": pairs, "arrived": int(there.sum()), "drawn": sampler.drawn, "median_s": float(np.nanmedian(seconds)),
        "longest_s": float(np.nanmax(seconds)), "median_off_m": float(np.median(off)), "most_off_m": float(off.max()),
        "median_turned_deg": math.degrees(np.median(turned)), "most_turned_deg": math.degrees(turned.max()),
        "over_curve": float(exact), "over_free_steering": float(free),
        "shelf_contacts": int(robots["totals"]["hits_shelf"].sum()),
    }  # fmt: skip


class _Sampler:
    """Draws poses that a body can have and leave."""

    def __init__(self, grid: GridMap, config: EnvConfig, seed: int) -> None:
        self._grid, self._rng, self.drawn = grid, np.random.default_rng(seed), 0
        self._params = parameters_of(config, grid.cell_size)
        self._floor = floor_of(grid, config.sensor.lidar_range)
        self._metric = turning_metric(self._params)
        self._scratch = make_search_scratch(1)
        self._cells = np.argwhere(largest_region(~grid.occupied))

    def pair(self, farthest: float) -> tuple[Pose, Pose]:
        """Return two poses, at most so far [m] from each other."""
        while True:
            start, goal = self._pose(), self._pose()
            apart = math.dist(start[:2], goal[:2])
            if NEAR <= apart <= farthest:
                return start, goal

    def _pose(self) -> Pose:
        cell, rng = self._grid.cell_size, self._rng
        while True:
            self.drawn += 1
            x, y = self._grid.centre(self._cells[rng.integers(len(self._cells))]) + cell * rng.uniform(-0.5, 0.5, 2)
            pose = (float(x), float(y), float(rng.uniform(-math.pi, math.pi)))
            if self._fits(*pose):
                return pose

    def _fits(self, *pose: float) -> bool:
        """Whether a body can stand at a pose, and get away from there."""
        p, floor, scratch = self._params[0], self._floor, self._scratch
        x, y, heading = (np.float32(value) for value in pose)
        c, s = np.cos(heading), np.sin(heading)
        body = body_of(x, y, c, s, p)
        if body_touches_shelf(grown(body, np.float32(MARGIN)), floor):
            return False
        scratch.avoid[0] = (*body, p["radius"])
        around = SearchArea(scratch.bodies[:0], scratch.rooms[:0], scratch.avoid, floor, self._metric, p)
        none, start = scratch.near[:0], pose_at(x, y, heading)
        query = Query(start, np.float32(0.0), FAR_OFF, none, none, around, TRIES, MOST, scratch)
        count, _ = search(query, np.empty((ARCS, 2), np.float32), None)
        return int(count) > 0


class _Piece(NamedTuple):
    """What is driven of a curve without standing."""

    length: float  # [m], signed
    steering: float  # [s] of standing before it


def curve_seconds(start: Pose, goal: Pose, robot: RobotSpec) -> tuple[float, float]:
    """Return the seconds that the soonest curve takes, with the time to steer and without."""
    radius = robot.wheelbase / math.tan(robot.max_steering)
    (ahead, left, turn), least = seen_from(*start, *goal), [math.inf, math.inf]
    for n in range(WORDS):
        length, *lengths = word(n, ahead, left, turn, radius)
        if math.isfinite(length):
            arcs = [(way, bend / radius) for way, bend in zip(lengths, TURNS[n].tolist(), strict=True) if way]
            for k, steers in enumerate((True, False)):
                least[k] = min(least[k], _seconds(_pieces(arcs, robot, steers), robot))
    return least[0], least[1]


def _pieces(arcs: Sequence[tuple[float, float]], robot: RobotSpec, steers: bool) -> list[_Piece]:
    pieces: list[_Piece] = []
    steer = 0.0
    for length, bend in arcs:
        wanted = math.atan(bend * robot.wheelbase)
        change = abs(wanted - steer) if steers else 0.0
        if pieces and pieces[-1].length * length > 0 and change < _STEER:
            pieces[-1] = _Piece(pieces[-1].length + length, pieces[-1].steering)
        else:
            pieces.append(_Piece(length, change / robot.max_steering_rate))
        steer = wanted
    return pieces


def _seconds(pieces: Sequence[_Piece], robot: RobotSpec) -> float:
    """Return the seconds that pieces take, each from rest to rest."""
    total = 0.0
    for length, steering in pieces:
        fastest, brake, way = robot.max_speed if length > 0 else -robot.min_speed, robot.max_acceleration, abs(length)
        total += steering
        total += way / fastest + fastest / brake if way > fastest**2 / brake else 2 * math.sqrt(way / brake)
    return total


def poses_table(rows: Sequence[Row]) -> Table:
    """Return the table of `poses`' rows."""
    header = (
        "floor", "pairs", "arrive", "median [s]", "longest [s]", "off, median / most [cm]",
        "turned, median / most [deg]", "over the curve", "steering in no time",
    )  # fmt: skip
    cells = tuple(
        (
            f"{row['floor']}, near" if row["near"] else row["floor"], str(row["pairs"]), str(row["arrived"]),
            number(row["median_s"]), number(row["longest_s"]),
            f"{100 * row['median_off_m']:.1f} / {100 * row['most_off_m']:.1f}",
            f"{row['median_turned_deg']:.1f} / {row['most_turned_deg']:.1f}",
            f"{row['over_curve']:.2f}", f"{row['over_free_steering']:.2f}",
        )
        for row in rows
    )  # fmt: skip
    far = [row for row in rows if not row["near"]]
    arrived, pairs = sum(row["arrived"] for row in far), sum(row["pairs"] for row in far)
    note = (
        f"One robot a world at full speed, routes by {PLANNER}; {arrived} of {pairs} arrive "
        f"({100 * arrived / pairs:.2f}%) within {PATIENCE:g} s; {sum(row['shelf_contacts'] for row in rows)} shelf "
        "contacts. Median time over that of the soonest Reeds-Shepp curve between the two poses, driven exactly, and "
        "where steering takes no time."
    )
    return Table("From pose to pose", header, cells, note)
