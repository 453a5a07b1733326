"""Telling moments: others as they stand or drive at one moment, and where one robot is put to see what a policy does.

In an aisle two cells wide, on a crossing, beside a bay: the floors of scenes.py. The robot in question, the ego, drives
east; it is put at every point of a fine lattice around its route, heading along it, and the policy is asked there.
And a jam that dissolves: the scene in which most robots stand at once and all arrive, and four moments of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents import make_policy
from agents.learned import LearnedPolicy
from agents.policy import Observation
from train.evaluation.rollout import config_of
from train.evaluation.scenes import SCENES, SceneJob, crossing, head_on
from train.reporting.rows import Row
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.render.probability_maps import Moments, ProbabilityMap, View
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment

CRUISE = EnvConfig().robot.max_speed  # [m/s]
ALONG, ACROSS = 0.2, 0.1  # [m] between two points of the lattice

Driving = tuple[float, float, float, float]  # front axle x [m], y [m], heading [rad]; speed [m/s]


@dataclass(frozen=True, eq=False)
class Moment:
    """A floor, the others and their goals, the ego's start and goal; the lattice fills a part of the floor."""

    title: str
    grid: GridMap
    others: tuple[Driving, ...]
    ego: tuple[float, float, float]  # where its route begins: x [m], y [m], heading [rad]
    goals: tuple[Cell, ...]  # of the others, then the ego's
    lattice: View
    view: View  # what of the floor is drawn


def _in_an_aisle(title: str, bay: bool, other: Driving, top: float) -> Moment:
    """Return a moment in the aisle of two cells; top: the upper edge of what is drawn [m]."""
    return Moment(
        title, head_on(2, bay).grid, (other,), (7.5, 2.5, 0.0), ((1, 1), (1, 26)), View(7.0, 19.0, 2.0, 4.0),
        View(6.5, 19.5, 1.5, top),
    )  # fmt: skip


def _crossing() -> Moment:
    north, south = math.pi / 2, -math.pi / 2
    others = ((13.5, 10.0, north, CRUISE), (12.5, 17.5, south, CRUISE), (18.0, 13.5, math.pi, CRUISE))
    return Moment(
        "A crossing", crossing().grid, others, (5.5, 12.5, 0.0), ((1, 10), (24, 15), (15, 1), (10, 24)),
        View(6.0, 15.6, 12.0, 14.0), View(5.6, 19.2, 8.8, 18.6),
    )  # fmt: skip


MOMENTS: dict[str, Callable[[], Moment]] = {
    "head_on": partial(_in_an_aisle, "Head-on in an aisle of two cells", False, (16.0, 3.0, math.pi, CRUISE), 4.5),
    "crossing": _crossing,
    "leaving": partial(_in_an_aisle, "A robot leaves its place", True, (14.0, 3.9, -math.pi / 2, 0.5), 5.5),
}


class Asked:
    """What a policy of discrete actions is likely to do, in four chances that are read off its probabilities.

    stop: to stop or back up; slow: to drive, but below its fastest level; right, left: to drive on that side of the
    route. The first two leave what is driven fast, the last two and `stop` what is driven on the route itself.
    """

    CHANCES: ClassVar[dict[str, str]] = {
        "stop": "stop or back up",
        "slow": "drive slowly",
        "right": "pass on the right",
        "left": "pass on the left",
    }

    def __init__(self, policy: str, config: EnvConfig) -> None:
        """Load the policy; ConfigError where it has no probabilities."""
        made = make_policy(policy, config)
        if not isinstance(made, LearnedPolicy) or config.action_type != "discrete":
            lacks = "has no probabilities of actions; name a trained one of discrete actions"
            raise ConfigError(f"policy {policy!r} {lacks}")
        self._policy = made
        speed, offset = np.array([(v, o) for v in config.speed_levels for o in config.lateral_offsets]).T
        drives = speed > 0
        slow = drives & (speed < speed.max())
        self._classes = np.stack([~drives, slow, drives & (offset < 0), drives & (offset > 0)], axis=1)

    def __call__(self, observation: Observation) -> NDArray[np.float64]:
        """Return the chances in the order of CHANCES, float64[..., 4] from float32[..., D]."""
        logits = self._policy.preferences(observation).astype(np.float64)
        likely = np.exp(logits - logits.max(axis=-1, keepdims=True))
        return np.asarray(likely @ self._classes / likely.sum(axis=-1, keepdims=True))


def map_of(moment: Moment, policy: str, config: EnvConfig) -> ProbabilityMap:
    """Ask a policy at every point of a moment's lattice; one world a point, so each sees what it would see there.

    config: as the policy needs it, but for the number of robots.
    """
    asked = Asked(policy, config)
    count = len(moment.goals)
    x, y = moment.lattice.points(ALONG, ACROSS)
    simulator = Simulator(config.replace(num_agents=count), x.size * y.size, grid=moment.grid)
    start = np.array([*(other[:3] for other in moment.others), moment.ego])
    simulator.reset_to([Assignment(start, np.array(moment.goals))] * simulator.num_worlds, 0)
    route = simulator.routes[0, -1, : simulator.state.route_points[0, -1]].astype(np.float64)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    pose = np.tile(start, (len(points), 1, 1))
    pose[:, -1] = np.column_stack([points, headings_along(route, points)])
    speed = np.array([*(other[3] for other in moment.others), CRUISE])
    free = simulator.put(pose, speed)
    chances = np.where(free[:, None], asked(simulator.observation[:, -1]), np.nan)
    shown = {name: chances[:, k].reshape(len(y), len(x)) for k, name in enumerate(Asked.CHANCES.values())}
    heading = pose[:, -1, 2].reshape(len(y), len(x))
    return ProbabilityMap(moment.grid, config.robot, x, y, heading, shown, start[:-1], speed[:-1], route, moment.view)


def rows_of_map(one: ProbabilityMap) -> list[Row]:
    """Return a row for each point of the lattice where the robot can be: pose, and its chances."""
    rows = []
    for (r, c), stop in np.ndenumerate(one.chances[Asked.CHANCES["stop"]]):
        if np.isfinite(stop):
            chances = {short: one.chances[name][r, c] for short, name in Asked.CHANCES.items()}
            rows.append({"x": one.x[c], "y": one.y[r], "heading": one.heading[r, c], "speed": CRUISE, **chances})
    return rows


def headings_along(route: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the direction [rad] of a route float[R, 2] [m] where it is nearest to each of points float[K, 2] [m]."""
    begin, step = route[:-1], np.diff(route, axis=0)
    apart = points[:, None] - begin
    share = ((apart * step).sum(axis=2) / (step**2).sum(axis=1)).clip(0.0, 1.0)
    nearest = np.hypot(*np.moveaxis(apart - share[..., None] * step, 2, 0)).argmin(axis=1)
    return np.asarray(np.arctan2(step[nearest, 1], step[nearest, 0]))


STANDS = 5.0  # [s] within a metre of one place from which a robot counts as standing
ROUND = 1.8  # [m] of floor shown around the front axles of all that are not parked


class Frame(NamedTuple):
    """The robots after a step: pose [N, 3], speed [N] [m/s], chances [N, 4], alive [N], standing [N]."""

    seconds: float
    pose: NDArray[np.float32]
    speed: NDArray[np.float32]
    chances: NDArray[np.float64]
    alive: NDArray[np.bool_]
    standing: NDArray[np.bool_]


class Film:
    """A watcher that keeps every step of the first world, and what its robots were about to do."""

    def __init__(self, asked: Asked) -> None:
        self._asked = asked
        self.frames: list[Frame] = []
        self.grid: GridMap | None = None

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Keep the robots as they are."""
        self.grid = simulator.grid
        state, alive = simulator.state, simulator.state.alive[0] > 0
        chances = self._asked(simulator.observation[0])
        standing = alive & (simulator.robots["standing_time"][0] >= STANDS)
        seconds = simulator.seconds(0)
        self.frames.append(Frame(seconds, state.pose[0].copy(), state.speed[0].copy(), chances, alive, standing))

    @property
    def waiting(self) -> NDArray[np.int64]:
        """How many robots stand after each step, int64[T]."""
        return np.array([frame.standing.sum() for frame in self.frames])

    def telling(self) -> list[Frame]:
        """Return four frames: half of the most stand, the most stand, again half of them do, nobody does."""
        waiting = self.waiting
        most = int(waiting.max())
        peak = np.flatnonzero(waiting == most)
        worst = int(peak[len(peak) // 2])
        after = waiting[worst:]
        return [
            self.frames[k]
            for k in (
                int(np.argmax(2 * waiting >= most)),
                worst,
                worst + int(np.argmax(2 * after <= most)),
                worst + int(np.argmax(after == 0)),
            )
        ]


def worst_jam(
    policy: str, base: EnvConfig, seconds: float, seed: int, tick: Callable[[], None], chosen: Mapping[str, Any] = {}
) -> tuple[str, Film] | None:
    """Play every scene once; return name and film of the one, of those in which all arrive, where most stand at once.

    None if they all arrive nowhere. tick is called after each.
    """
    worst: tuple[str, Film] | None = None
    for name in SCENES:
        film = Film(Asked(policy, config_of(policy, base, chosen)))
        job = SceneJob(name, policy, base, seconds, range(seed, seed + 1), chosen)
        (row,) = job.run(lambda done: None, [film]).rows
        if row["resolved"] and (worst is None or film.waiting.max() > worst[1].waiting.max()):
            worst = name, film
        tick()
    return worst


def moments_of(film: Film, config: EnvConfig) -> Moments:
    """Return the telling moments of a film, and the part of the floor where robots stand or drive in them."""
    frames, grid = film.telling(), film.grid
    assert grid is not None
    pose = np.stack([frame.pose for frame in frames])
    driving = np.concatenate([frame.pose[frame.alive, :2] for frame in frames])
    low, high = driving.min(axis=0) - ROUND, driving.max(axis=0) + ROUND
    low, high = low.clip(0), high.clip(max=np.array(grid.shape[::-1]) * grid.cell_size)
    return Moments(
        grid, config.robot, np.array([frame.seconds for frame in frames]), pose,
        np.stack([frame.speed for frame in frames]), np.stack([1.0 - frame.chances[:, 0] for frame in frames]),
        np.stack([frame.alive for frame in frames]), View(float(low[0]), float(high[0]), float(low[1]), float(high[1])),
    )  # fmt: skip


def rows_of_film(one: Film) -> list[Row]:
    """Return a row for each robot in each of the telling moments: pose, speed, and its chances."""
    return [
        {
            "seconds": frame.seconds, "robot": i, "x": x, "y": y, "heading": heading, "speed": frame.speed[i],
            "alive": frame.alive[i], **dict(zip(Asked.CHANCES, frame.chances[i], strict=True)),
        }
        for frame in one.telling()
        for i, (x, y, heading) in enumerate(frame.pose)
    ]  # fmt: skip
