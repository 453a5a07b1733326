"""Simulator: the one stateful object around the kernels: config, random generators, state arrays, routes, tasks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.observation import observation_layout
from warehouse_env.planning.plan import Planner
from warehouse_env.planning.routes import RouteBook
from warehouse_env.simulation import metrics, state, step
from warehouse_env.simulation.actions import ActionDecoder
from warehouse_env.simulation.buckets import bucket_grid
from warehouse_env.simulation.floor import floor_of, load_grid
from warehouse_env.simulation.placement import place
from warehouse_env.simulation.rewards import REWARD_TERMS, weight_vector
from warehouse_env.simulation.tasks import Tasks
from warehouse_env.threads import MOST_THREADS, get_num_threads, side_by_side

PARALLEL_FROM = 256  # robots in all from which waking other threads pays
_PARTS = 4  # of the worlds for each thread: who is done early, or has a core for itself, does more of them
_PART = 32  # robots in a part at least
_ROUTE_BLOCK = 64  # way-points by which the routes' array grows


class Simulator:
    """B independent worlds of N robots in lock-step.

    Outputs are the simulator's own arrays, overwritten by the next step: `observation` float32[B, N, D], `reward`
    float32[B, N], `reward_terms` float32[B, N, T] in the order of REWARD_TERMS, `terminated` bool[B, N] (not alive
    any more), `truncated` bool[B] (max_steps reached; stepping on is allowed), and the views `state` and `events`.
    """

    def __init__(
        self,
        config: EnvConfig,
        num_worlds: int = 1,
        *,
        grid: GridMap | None = None,
        planner: Planner | None = None,
        routes: RouteBook | None = None,
    ) -> None:
        """Build the worlds; call `reset` before the first step.

        grid, planner: instead of those that the config names; routes: a RouteBook shared with other simulators.
        """
        if num_worlds < 1:
            raise ConfigError(f"num_worlds={num_worlds} must be at least 1")
        self.config, self.num_worlds, self.num_agents = config, num_worlds, config.num_agents
        self.grid = routes.grid if routes is not None else grid if grid is not None else load_grid(config)
        if routes is None:
            from warehouse_env.planning import make_planner

            planner = planner if planner is not None else make_planner(config.planner)
            smooth_for = config.robot if config.smooth_routes else None
            routes = RouteBook(self.grid, planner, keep_right=config.keep_right, smooth_for=smooth_for)
        self.route_book = routes
        self.layout = observation_layout(config)
        self._tasks = [Tasks(self.grid, config) for _ in range(num_worlds)]
        self._rngs = [np.random.default_rng() for _ in range(num_worlds)]
        self._params = state.parameters_of(config, self.grid.cell_size)
        self._floor = floor_of(self.grid)
        self._make_spaces()
        self._weights = weight_vector(config.reward)
        self._reward_weights = config.reward
        self._make_arrays()

    def _make_spaces(self) -> None:
        config = self.config
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (self.layout.size,), np.float32)
        self._actions = ActionDecoder(config)
        self.action_space = self._actions.space
        angles = 2 * math.pi * np.arange(config.sensor.rays) / config.sensor.rays
        self._rays = np.column_stack([np.cos(angles), np.sin(angles)]).astype(np.float32)

    def _make_arrays(self) -> None:
        b, n, p = self.num_worlds, self.num_agents, self._params
        self.robots = np.zeros((b, n), dtype=state.ROBOT)
        self.state, self.events = state.state_of(self.robots), state.events_of(self.robots)
        self.routes = np.zeros((b, n, _ROUTE_BLOCK, 2), dtype=np.float32)  # [m]; state.route_points are valid
        self.observation = np.zeros((b, n, self.layout.size), dtype=np.float32)
        self.reward = np.zeros((b, n), dtype=np.float32)
        self.reward_terms = np.zeros((b, n, len(REWARD_TERMS)), dtype=np.float32)
        self.terminated = np.zeros((b, n), dtype=np.bool_)
        self.truncated = np.zeros(b, dtype=np.bool_)
        self.steps = np.zeros(b, dtype=np.int64)  # env steps since each world's reset
        self._commands = np.zeros((b, n, 2), dtype=np.float32)
        reach = float(p["pair_range"][0])
        area = math.pi * (reach + float(p["radius"][0])) ** 2 / (self.config.robot.length * self.config.robot.width)
        most = min(n * (n - 1) // 2, n * (math.ceil(area) // 2 + 1))
        self._pairs = np.zeros((b, max(most, 1), 3), dtype=np.int32)
        self._stamps = np.zeros((b, n, n), dtype=np.int32)
        self._clocks = np.ones(b, dtype=np.int32)
        rows, columns = self.grid.shape
        size = self.grid.cell_size
        look = max(self.config.sensor.lidar_range + float(p["radius"][0]), 2 * reach)
        bucket_rows, bucket_columns, side = bucket_grid(n, columns * size, rows * size, look)
        self._heads = np.zeros((b, bucket_rows, bucket_columns), dtype=np.int32)
        self._nexts = np.zeros((b, n), dtype=np.int32)
        self._side = np.float32(side)
        self._bind()

    def _bind(self) -> None:
        """Keep the kernels' arguments ready: collecting them takes longer than a small world's step."""
        share = max(math.ceil(self.num_worlds / (_PARTS * MOST_THREADS)), math.ceil(_PART / self.num_agents))
        starts = range(0, self.num_worlds, share)
        worlds = [slice(None), *(slice(start, start + share) for start in starts)]
        self._advance_arguments = [self._to_advance(some) for some in worlds]  # all worlds, then part by part
        self._observe_arguments = [self._to_observe(some) for some in worlds]

    def _to_advance(self, some: slice) -> tuple[Any, ...]:
        """Return the arguments of `step.advance` for some of the worlds."""
        return (
            self.robots[some], self.routes[some], self._commands[some], self._stamps[some], self._pairs[some],
            self._heads[some], self._nexts[some], self._side, self._clocks[some],
            self._params, self._floor.solid, self._floor.clearance,
        )  # fmt: skip

    def _to_observe(self, some: slice) -> tuple[Any, ...]:
        """Return the arguments of `step.observe` for some of the worlds."""
        return (
            self.robots[some], self.routes[some], self._heads[some], self._nexts[some], self._side,
            self._params, self._rays, self._actions.table, self._weights, self._floor.solid,
            self.observation[some], self.reward_terms[some], self.reward[some],
        )  # fmt: skip

    @property
    def reward_weights(self) -> RewardWeights:
        """The weights in force; may be set at any time (for schedules)."""
        return self._reward_weights

    @reward_weights.setter
    def reward_weights(self, weights: RewardWeights) -> None:
        self._reward_weights = weights
        self._weights[:] = weight_vector(weights)

    @property
    def cruise_action(self) -> NDArray[Any]:
        """One robot's action that drives along the route at full speed (raw: no command at all)."""
        return self._actions.cruise

    def seconds(self, world: int) -> float:
        """Simulated time [s] since the world's reset."""
        return int(self.steps[world]) * self.config.action_repeat * self.config.time_step

    def reset(self, seed: int | Sequence[int] | None = None) -> NDArray[np.float32]:
        """Start all worlds anew and return the observation.

        seed: an int (world b draws from SeedSequence([seed, b])), one int a world (each then equals a single world
        reset with that int), or None (each world goes on with its own generator).
        """
        if seed is None:
            seeds: list[list[int] | None] = [None] * self.num_worlds
        elif isinstance(seed, (int, np.integer)):
            seeds = [[int(seed), b] for b in range(self.num_worlds)]
        else:
            if len(seed) != self.num_worlds:
                raise ConfigError(f"seed has {len(seed)} entries for {self.num_worlds} worlds; give one for each")
            seeds = [[int(s), 0] for s in seed]
        for world, entropy in enumerate(seeds):
            self._reset_world(world, entropy)
        self._observe()
        return self.observation

    def reset_world(self, world: int, seed: int | None = None) -> None:
        """Start one world anew; its row of `observation` is updated. seed None: its generator goes on."""
        self._reset_world(world, None if seed is None else [int(seed), 0])
        self._observe(world)

    def _reset_world(self, world: int, entropy: list[int] | None) -> None:
        if entropy is not None:
            if min(entropy) < 0:
                raise ConfigError(f"seed={entropy[0]} must not be negative")
            self._rngs[world] = np.random.default_rng(np.random.SeedSequence(entropy))
        robots = self.robots[world]
        robots[...] = np.zeros((), dtype=state.ROBOT)
        self._stamps[world] = 0
        self._clocks[world] = 1
        self.steps[world] = 0
        self._commands[world] = 0
        self.truncated[world] = False
        self.terminated[world] = False
        robots["alive"] = 1
        robots["gear"] = 1
        robots["gap"] = robots["min_gap"] = state.GAP_HORIZON
        self._tasks[world].reset(self._rngs[world])
        self._place_all(world)

    def _place_all(self, world: int) -> None:
        """Give every robot of a world a start, a goal and a route."""
        rng, tasks = self._rngs[world], self._tasks[world]
        places = [tasks.places[k] for k in rng.permutation(len(tasks.places))[::-1]]
        cells, spare = places[: self.num_agents], places[self.num_agents :]
        goals = [tasks.next_goal(robot, cell, rng) for robot, cell in enumerate(cells)]
        self.route_book.prepare(list(zip(cells, goals, strict=True)))
        for robot in range(self.num_agents):
            placed = robot < len(cells) and self._place(world, robot, cells[robot], goals[robot])
            while not placed:
                if not spare:
                    raise ConfigError(
                        f"num_agents={self.num_agents} do not fit on map {self.grid.name!r}: only {robot} found a "
                        "start that touches nothing; use fewer robots or a larger map"
                    )
                cell = spare.pop(0)
                placed = self._place(world, robot, cell, tasks.next_goal(robot, cell, rng))

    def _place(self, world: int, robot: int, cell: Cell, goal: Cell) -> bool:
        """Put a robot on a cell, facing along its route; False if it touches something there."""
        self._set_route(world, robot, cell, goal)
        route = self.routes[world, robot]
        direction = route[min(2, max(int(self.robots[world, robot]["points"]) - 1, 0))] - route[0]
        return place(self.robots[world], robot, self.grid.centre(cell), direction, self._params, self._floor)

    def _set_route(self, world: int, robot: int, start: Cell, goal: Cell, heading: float | None = None) -> None:
        points = self.route_book.route(start, goal, heading)
        if len(points) > self.routes.shape[2]:
            longer = math.ceil(len(points) / _ROUTE_BLOCK) * _ROUTE_BLOCK
            grown = np.zeros((self.num_worlds, self.num_agents, longer, 2), dtype=np.float32)
            grown[:, :, : self.routes.shape[2]] = self.routes
            self.routes = grown
            self._bind()
        self.routes[world, robot, : len(points)] = points
        r = self.robots[world, robot]
        r["points"] = len(points)
        r["spacing"] = np.hypot(*(points[1] - points[0])) if len(points) > 1 else 0.0
        r["position"] = r["milestone"] = r["stalled_time"] = 0.0
        r["lateral"] = r["bearing"] = 0.0
        r["gear"] = 1
        r["goal_x"], r["goal_y"] = points[-1]
        r["goal_row"], r["goal_col"] = goal

    def step(self, actions: ArrayLike) -> NDArray[np.float32]:
        """Advance all worlds by one env step (action_repeat physics steps) and return the observation.

        actions: int[B, N] of a discrete config, else float[B, N, 2] in [-1, 1] (clipped). ActionError if of another
        shape, out of range or not finite.
        """
        self._actions.decode(actions, self._commands)
        parts = slice(1, None) if self._many() else slice(1)
        arrivals = sum(side_by_side(step.advance, self._advance_arguments[parts]))
        self.steps += 1
        if self.config.terminate_on_collision:
            self._park_collided()
        if arrivals:
            self._arrive()
        np.greater_equal(self.steps, self.config.max_steps, out=self.truncated)
        if self.config.tasks == "one_shot" or self.config.terminate_on_collision:
            np.equal(self.robots["alive"], 0, out=self.terminated)
        side_by_side(step.observe, self._observe_arguments[parts])
        return self.observation

    def _many(self) -> bool:
        return self.num_worlds > 1 and self.num_worlds * self.num_agents >= PARALLEL_FROM and get_num_threads() > 1

    def _park_collided(self) -> None:
        robots = self.robots
        hit = (robots["alive"] != 0) & ((robots["hit_robot"] > 0) | (robots["hit_shelf"] > 0))
        robots["alive"][hit] = 0
        robots["speed"][hit] = 0

    def _arrive(self) -> None:
        """Book the arrivals, and give lifelong robots their next task and route."""
        for world, robot in np.argwhere(self.robots["arrived"] != 0).tolist():
            r = self.robots[world, robot]
            r["goals"] += 1
            r["planned"] += float(r["points"] - 1) * float(r["spacing"])
            r["driven_to_goals"] += r["distance"] - r["distance_at_goal"]
            r["distance_at_goal"] = r["distance"]
            r["finish_time"] = self.seconds(world)
            if self.config.tasks == "lifelong" and r["alive"]:
                start = (int(r["goal_row"]), int(r["goal_col"]))
                goal = self._tasks[world].next_goal(robot, start, self._rngs[world])
                self._set_route(world, robot, start, goal, float(r["heading"]))

    def _observe(self, world: int | None = None) -> None:
        step.observe(*self._to_observe(slice(None) if world is None else slice(world, world + 1)))

    def episode_metrics(self, world: int = 0) -> dict[str, float]:
        """Return the row of numbers of a world's episode so far (see metrics.episode_row)."""
        return metrics.episode_row(self.robots[world], self.seconds(world), self.config)

    def global_state(self, world: int = 0) -> NDArray[np.float32]:
        """Return float32[N * 8] for centralised critics: per robot x, y, goal x, y / the map's longer side,
        cos and sin of the heading, speed / max_speed, steering / max_steering.
        """
        r, robot = self.robots[world], self.config.robot
        size = np.float32(max(self.grid.shape) * self.grid.cell_size)
        columns = [r["x"] / size, r["y"] / size, r["goal_x"] / size, r["goal_y"] / size, r["cos"], r["sin"]]
        columns += [r["speed"] / np.float32(robot.max_speed), r["steer"] / np.float32(robot.max_steering)]
        return np.stack(columns, axis=-1).astype(np.float32).reshape(-1)
