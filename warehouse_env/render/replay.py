"""The arrays that the replay page shows of one world, collected by running the episode again.

Lines are simplified to fewer points by Douglas and Peucker (1973).
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import GridMap


def simplified(line: NDArray[np.float32], within: float) -> NDArray[np.float32]:
    """Return a line float32[K, 2] [m] with fewer points, its ends among them; dropped ones lie within `within` [m]."""
    if len(line) < 3:
        return line.copy()
    kept: NDArray[np.float32] = line[_needed(line.astype(np.float64), within)]
    return kept


@kernel
def _needed(line, within):
    """Return bool[K], the points of a line float64[K, 2] without which one would lie farther than `within` from it."""
    needed = np.zeros(line.shape[0], np.bool_)
    needed[0] = needed[-1] = True
    left = [(0, line.shape[0] - 1)]  # parts between two points that are needed
    while len(left) > 0:
        first, last = left.pop()
        worst, at = within, -1
        for k in range(first + 1, last):
            beside = _distance(line, k, first, last)
            if beside > worst:
                worst, at = beside, k
        if at >= 0:
            needed[at] = True
            left.append((first, at))
            left.append((at, last))
    return needed


@kernel
def _distance(line, k, first, last):
    """Return how far a point of a line lies from the segment between two others [m]."""
    across, up = line[last, 0] - line[first, 0], line[last, 1] - line[first, 1]
    x, y = line[k, 0] - line[first, 0], line[k, 1] - line[first, 1]
    length = across * across + up * up
    share = min(1.0, max(0.0, (x * across + y * up) / length)) if length > 0 else 0.0
    return np.hypot(x - share * across, y - share * up)


Shares = Callable[[NDArray[np.float32]], NDArray[np.floating[Any]]]
"""A policy's preferences: shares in [0, 1] float[1, N, A] from observations float32[1, N, D]."""

REWARD_TERMS = tuple(field.name for field in dataclasses.fields(RewardWeights))
FLAGS = (
    "alive", "loaded", "touching", "deadlocked", "arrived", "hit_robot", "hit_shelf", "near_miss", "hit_person",
    "served", "silent",
)  # fmt: skip
_STRAIGHT = 0.001  # [m] from a straight line within which a way-point is dropped


@dataclass(frozen=True, eq=False)
class Replay:
    """One world of N robots at F moments: after the reset, and after each of F - 1 steps."""

    name: str
    grid: GridMap
    config: EnvConfig
    seed: int
    pose: NDArray[np.float32]  # [F, N, 3] front axle x [m], y [m], heading [rad]
    speed: NDArray[np.float32]  # [F, N] [m/s]
    steer: NDArray[np.float32]  # [F, N] [rad], of the steered wheels
    goal: NDArray[np.int32]  # [F, N], row * columns + column of the cell
    flags: NDArray[np.uint16]  # [F, N], bit k is FLAGS[k]
    waits_for: NDArray[np.int32]  # [F, N], the robot that a standing one waits for, else -1
    yields_to: NDArray[np.int32]  # [F, N], the robot that it gives way to by right of way, else -1
    held_by: NDArray[np.int32]  # [F, N], the robot for which the shield brakes it, else -1
    rewards: NDArray[np.float32]  # [F, N, R], the weighed terms of the last step, in the order of REWARD_TERMS
    routes: tuple[NDArray[np.float32], ...]  # each [K, 2] [m], without way-points on straight parts
    route: NDArray[np.int32]  # [F, N], index of its route
    along: NDArray[np.float32]  # [F, N] [m] driven along it
    people: NDArray[np.float32]  # [F, M, 3] x [m], y [m], walking direction [rad]
    totals: NDArray[np.int32]  # [F, 3], goals, collisions and near misses so far; one of a pair counts once
    liked: NDArray[np.float32] | None = None  # [F, N, A] in [0, 1], the policy's preferences
    ends: NDArray[np.float32] | None = None  # [F, N, 3], see `goal_poses`
    every: int = 1  # steps between two moments

    @property
    def seconds(self) -> float:
        """Simulated time between two moments [s]."""
        return self.every * self.config.action_repeat * self.config.time_step


def replay_of(
    episode: Any, name: str, policy: Shares | None = None, world: int = 0,
    moved: Callable[[Any], object] = lambda _: None,
) -> Replay:  # fmt: skip
    """Run an episode again and keep what the page shows of one world.

    episode: an Episode of simulation/record/recording.py, or anything with its `config`, `grid`, `seeds`, `pose` and
    `replay`. policy: asked at every moment for its preferences. moved: called at every moment with the simulator.
    Raises ConfigError for a world that the episode does not have, WarehouseError where the run differs from the
    recorded poses.
    """
    if not 0 <= world < len(episode.seeds):
        raise ConfigError(f"world={world} must be one of the episode's {len(episode.seeds)}, which count from 0")
    lines = Lines()
    moments: dict[str, list[NDArray[Any]]] = {}
    stations = episode.grid.marked(episode.grid.stations)
    for simulator in episode.replay():
        moment = moment_of(simulator, world, stations)
        moment["route"] = lines.numbers(simulator, world)
        if policy is not None:
            moment["liked"] = np.asarray(policy(simulator.observation[world : world + 1])[0], dtype=np.float32)
        for what, values in moment.items():
            moments.setdefault(what, []).append(values)
        moved(simulator)
    arrays: dict[str, Any] = {what: np.stack(values) for what, values in moments.items()}
    if not np.array_equal(arrays["pose"], episode.pose[:, world]):
        raise WarehouseError(
            "this episode cannot be run again to the bit: it was recorded by another version, or its robots were "
            "driven by more than its actions"
        )
    seed, routes = episode.seeds[world], tuple(lines.found)
    return Replay(name, episode.grid, episode.config, seed, routes=routes, **arrays)


def moment_of(simulator: Any, world: int, stations: NDArray[np.bool_]) -> dict[str, NDArray[Any]]:
    """Copy what the page shows of one world now, except routes. A robot is loaded on its way to a station, or if it
    carries an order; it is served while it stands to be loaded or to charge. Only a real fleet's may be silent.

    stations: bool[H, W], which cells are stations.
    """
    state, events, robots = simulator.state, simulator.events, simulator.robots[world]
    jams = simulator.jams()
    row, column = state.goal[world].T
    goal = row * simulator.grid.shape[1] + column
    alive, loaded, shifts = state.alive[world] > 0, stations[row, column], simulator.dispatcher.shifts
    served = silent = np.zeros_like(alive)
    if shifts is not None:
        served, loaded = shifts[world].at_work() & ~alive, shifts[world].carries
        silent = getattr(shifts[world], "silent", silent)
    bits = (
        alive | served, loaded, events.touching[world], jams.cycle[world] >= 0, events.arrived[world],
        events.hit_robot[world], events.hit_shelf[world], events.near_miss[world], events.hit_person[world],
        served, silent,
    )  # fmt: skip
    flags = sum((np.asarray(bit) > 0).astype(np.uint16) << k for k, bit in enumerate(bits))
    ends = goal_poses(simulator, world)
    return ({} if ends is None else {"ends": ends}) | {
        "pose": state.pose[world].copy(), "speed": state.speed[world].copy(), "steer": state.steer[world].copy(),
        "goal": goal.astype(np.int32), "flags": np.asarray(flags, dtype=np.uint16),
        "waits_for": jams.waits_for[world], "yields_to": robots["traffic"]["yields_to"].copy(),
        "held_by": robots["shield"]["vetoed_by"].copy(), "rewards": simulator.reward_terms[world].copy(),
        "along": state.route_position[world].copy(), "people": places(simulator.people.persons[world]),
        "totals": totals_of(robots),
    }  # fmt: skip


def goal_poses(simulator: Any, world: int) -> NDArray[np.float32] | None:
    """Return float32[N, 3], poses at goals: front axle x, y [m], heading [rad] (nan: any); None if robots pass."""
    robots = simulator.robots[world]
    if simulator.config.arrival == "pass":
        return None
    return np.stack([robots["task"][name] for name in ("goal_x", "goal_y", "goal_heading")], axis=-1)


def places(persons: NDArray[np.void]) -> NDArray[np.float32]:
    """Return float32[M, 3] of people PERSON[M]: x [m], y [m], walking direction [rad]."""
    return np.stack([persons["x"], persons["y"], np.arctan2(persons["sin"], persons["cos"])], axis=-1)


def totals_of(robots: NDArray[np.void]) -> NDArray[np.int32]:
    """Return int32[3], the goals, collisions and near misses of an episode so far, as its metrics count them."""
    names = ("goals", "hits_robot", "hits_shelf", "hits_person", "near_misses")
    goals, robot, shelf, person, near = (int(robots["totals"][name].sum()) for name in names)
    return np.array([goals, robot // 2 + shelf + person, near // 2], dtype=np.int32)


class Lines:
    """The routes seen so far, numbered from 0; a route that a robot keeps is stored once."""

    def __init__(self) -> None:
        self.found: list[NDArray[np.float32]] = []  # without those that `take` has returned
        self._taken = 0
        self._last: dict[int, tuple[int, NDArray[np.float32]]] = {}  # by robot: number, way-points

    def numbers(self, simulator: Any, world: int) -> NDArray[np.int32]:
        """Return int32[N], the number of the route that each robot is on."""
        counts = simulator.state.route_points[world].tolist()
        return np.array(
            [self._number(i, simulator.routes[world, i, :count]) for i, count in enumerate(counts)], dtype=np.int32
        )

    def take(self) -> dict[int, NDArray[np.float32]]:
        """Return the routes found since the last call, by number, and forget them."""
        taken = dict(enumerate(self.found, self._taken))
        self._taken += len(self.found)
        self.found = []
        return taken

    def current(self) -> dict[int, NDArray[np.float32]]:
        """Return the routes that robots are on, by number."""
        return {number: simplified(points, _STRAIGHT) for number, points in self._last.values()}

    def _number(self, robot: int, points: NDArray[np.float32]) -> int:
        known = self._last.get(robot)
        if known is not None and np.array_equal(known[1], points):
            return known[0]
        number = self._taken + len(self.found)
        self._last[robot] = (number, points.copy())
        self.found.append(simplified(points, _STRAIGHT))
        return number
