"""The Simulator, the one stateful object around the kernels: config, random generators, arrays, routes, tasks."""

import math
import weakref
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.errors import ConfigError, check_count, shown
from warehouse_env.kernel import compiled_for
from warehouse_env.maps.fitting import load_floor
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.observation import observation_layout
from warehouse_env.planning.plan import Planner
from warehouse_env.portable import Portable
from warehouse_env.routes.book import RouteBook
from warehouse_env.simulation import given, state, step
from warehouse_env.simulation.actions import ActionDecoder
from warehouse_env.simulation.draws import Draws
from warehouse_env.simulation.driver.manoeuvre import ARCS
from warehouse_env.simulation.driver.scratch import MOST, make_search_scratch
from warehouse_env.simulation.driver.turning import turning_metrics
from warehouse_env.simulation.physics.buckets import bucket_grid
from warehouse_env.simulation.physics.deviation import (
    begin_errors,
    deviation_of,
    draw_errors,
    errs,
    place_bodies,
    planned_config,
)
from warehouse_env.simulation.physics.floor import floor_of
from warehouse_env.simulation.physics.people import People
from warehouse_env.simulation.physics.poses import poses, speeds
from warehouse_env.simulation.physics.zones import zones_of
from warehouse_env.simulation.record import metrics
from warehouse_env.simulation.senses.extra import ExtraSensor
from warehouse_env.simulation.senses.messages import draw_silent, losses_of
from warehouse_env.simulation.senses.passages import passages_of
from warehouse_env.simulation.senses.rewards import REWARD_TERMS, weight_vector
from warehouse_env.simulation.senses.sensing import unit_vectors
from warehouse_env.simulation.tasks.assignment import Assignment, check_assignments
from warehouse_env.simulation.tasks.dispatch import ROUTE_BLOCK, Dispatcher
from warehouse_env.simulation.tasks.orders import Order
from warehouse_env.simulation.tasks.placement import Limits, put_all
from warehouse_env.simulation.tasks.tasks import Arrival
from warehouse_env.simulation.traffic import deadlock_recovery, local_activation, recovery
from warehouse_env.simulation.traffic.path_ahead import COLUMNS, POSES
from warehouse_env.simulation.traffic.waits import Jams, jams_of
from warehouse_env.simulation.worlds import Equipment, Features, Setup, ThreadScratch, Vehicles, Worlds, make_scratch
from warehouse_env.threads import MOST_THREADS, get_num_threads, side_by_side

PARALLEL_FROM = 256  # robots in all from which other threads pay off
_PARTS = 2  # parts of the worlds per thread, so that a thread that is done early does more
_LEAST, _MOST = 32, 1024  # robots in a part: more do not stay in a core's cache from step to observation


def _parts(worlds: int, share: int) -> list[tuple[int, int]]:
    """Return (begin, end) of parts of `share` worlds."""
    return [(first, min(first + share, worlds)) for first in range(0, worlds, share)]


def _new_book(config: EnvConfig, grid: GridMap | None, planner: Planner | None) -> RouteBook:
    """Return an empty book of routes; grid, planner: replace those that the config names."""
    from warehouse_env.planning import make_planner

    planner = make_planner(config.planner) if planner is None else planner
    return RouteBook(load_floor(config, grid), planner, keep_right=config.keep_right, wider=config.widest_body.wider)


def _limits(every_kind: NDArray[Any], config: EnvConfig) -> Limits:
    """Return the robots' parameters by those of their kinds, PARAMETERS[K]."""
    return every_kind[:1].copy(), every_kind[list(config.kind_of)] if config.fleet else None


class Simulator(Portable):
    """B independent worlds of N robots in lock-step.

    Outputs are the simulator's own arrays, overwritten by the next step: `observation` float32[B, N, D], `reward`
    float32[B, N], `reward_terms` float32[B, N, T] in the order of REWARD_TERMS, `terminated` bool[B, N], `truncated`
    bool[B] (max_steps reached; further steps are allowed), the views `state` and `events`, and `arrivals`, the tasks
    finished in the last step.
    """

    bound = (
        "state", "events", "_floor", "_rays", "_zones", "_compiled", "_worlds", "setup", "_scratch", "_extra",
    )  # fmt: skip

    def __init__(
        self, config: EnvConfig, num_worlds: int = 1, *, grid: GridMap | None = None, planner: Planner | None = None,
        routes: RouteBook | None = None, orders: Sequence[Order] | None = None,
    ) -> None:  # fmt: skip
        """Build the worlds; call `reset` before the first step.

        grid, planner, orders: replace those that the config names; routes: a RouteBook shared with other simulators.
        """
        given.check_parts(config, grid, planner, routes)
        num_worlds = check_count("num_worlds", num_worlds)
        self.config, self.num_worlds, self.num_agents = config, num_worlds, config.num_agents
        routes = _new_book(config, grid, planner) if routes is None else routes
        self.grid = routes.grid
        given.check_pace(config, self.grid.cell_size)
        planned = planned_config(config)
        given.check_stop(config, state.stop_samples(planned))
        self.layout = observation_layout(config)
        each = state.ROBOT.itemsize + 8 * ROUTE_BLOCK
        given.check_memory(config, num_worlds, self.layout.size, each, self.grid.occupied.size)
        self._every_kind = state.every_kind(planned, self.grid.cell_size, config.kinds)
        self._limits = _limits(self._every_kind, config)
        self._params, self._kinds = self._limits
        self.actions = ActionDecoder(planned)
        self.action_space = self.actions.space
        self._weights, self._reward_weights = weight_vector(config.reward), config.reward
        self._planned = np.zeros((num_worlds, config.num_agents), dtype=state.ROBOT)
        self.robots = self._planned.copy() if errs(config) else self._planned  # at their true poses
        self.people = People(planned, self.grid, num_worlds)
        self.draws = Draws(num_worlds)
        parts = self.people.persons, self._limits, self.draws, orders
        self.dispatcher = Dispatcher(planned, routes, self._planned, *parts)
        self.deviation, self.losses = deviation_of(config, num_worlds), losses_of(config, num_worlds)
        self._make_arrays(planned)

    def _make_arrays(self, planned: EnvConfig) -> None:
        b, n, self._decides = self.num_worlds, self.num_agents, self.config.traffic_spec.right_of_way
        self.arcs = np.zeros((b, n, ARCS, 2), dtype=np.float32)  # [m], [rad]; the robots' manoeuvres
        self._paths = np.zeros((b, n + 1 if self._decides else 0, POSES, COLUMNS), dtype=np.float32)
        self.observation = np.zeros((b, n, self.layout.size), dtype=np.float32)
        self.reward = np.zeros((b, n), dtype=np.float32)
        self.reward_terms = np.zeros((b, n, len(REWARD_TERMS)), dtype=np.float32)
        self.terminated = np.zeros((b, n), dtype=np.bool_)
        self.truncated = np.zeros(b, dtype=np.bool_)
        self.steps = np.zeros(b, dtype=np.int64)  # env steps since each world's reset
        self.arrivals: list[Arrival] = []
        # env steps until a command takes effect
        said = math.ceil(int(self._params["latency"][0]) / self.config.action_repeat)
        self._commands = np.zeros((1 + said, b, n, 2), dtype=np.float32)
        self._choices = self.actions.no_choices(b, n)
        self._stamps = np.zeros((b, n, state.most_near(n, self.config), 2), dtype=np.int32)
        self._fill_parameters(planned)
        self._waiting = np.zeros(b, dtype=np.int32)
        self._features = Features.of(self.config)
        most, least = max(_MOST // n, 1), math.ceil(_LEAST / n)
        self._blocks = _parts(b, most)
        self._parts = _parts(b, max(min(math.ceil(b / (_PARTS * MOST_THREADS)), most), least))
        self._bind()
        low, high = (-np.inf, np.inf) if self._extra is None else (self._extra.low, self._extra.high)
        self.observation_space = gymnasium.spaces.Box(low, high, (self.layout.size,), np.float32)

    def _fill_parameters(self, planned: EnvConfig) -> None:
        """Write the ranges and buckets of neighbours, and make the parameters of the true bodies."""
        n, p, (rows, columns) = self.num_agents, self._params, self.grid.shape
        reach, widest = float(p["pair_range"][0]), float(p["widest"][0])
        size = self.grid.cell_size
        look = max(
            self.config.sensor.lidar_range + widest,
            2 * max(reach, float(p["field_range"][0]) if self.config.traffic_spec.shield else 0.0),
        )
        bucket_rows, bucket_columns, side = bucket_grid(n, columns * size, rows * size, look)
        shared = {
            "most_pairs": state.most_pairs(n, reach, widest, planned),
            "bucket_rows": bucket_rows, "bucket_columns": bucket_columns, "bucket": side,
        }  # fmt: skip
        self._true_params, self._true_kinds = self._limits  # of the bodies, if they differ from the plan
        if self.robots is not self._planned:
            self._true_params, self._true_kinds = _limits(state.every_kind(self.config, size), self.config)
        for records in (p, self._kinds, self._true_params, self._true_kinds):
            if records is not None:
                for name, value in shared.items():
                    records[name] = value

    def _bind(self) -> None:
        """Make the views, the floor and the kernels' arguments."""
        self.state, self.events = state.state_of(self.robots), state.events_of(self.robots)
        self._floor = floor_of(self.grid, self.config.sensor.lidar_range)
        self._zones = zones_of(self.grid, planned_config(self.config))
        self._rays = unit_vectors(self.config.sensor.rays)
        self._extra = None if self.config.sensor.extra is None else ExtraSensor(self.config, self.layout)
        self._compiled: dict[Callable[..., Any], Callable[..., Any]] = {}  # kernels, compiled when first called
        me = weakref.proxy(self)
        self._scratch = ThreadScratch(
            lambda: make_scratch(me.setup, me.num_agents, me._decides),
            lambda: make_search_scratch(me.num_agents, me.config.people, POSES, me.search_setup.nodes),
        )
        self._collect()

    def _collect(self) -> None:
        """Collect the kernels' arguments once: to do so takes longer than a small world's step."""
        shifts, people, deviation = self.dispatcher.shifts, self.people, self.deviation
        table, passages = None, None
        if self.config.sensor.predictions:  # commands of each kind of robots, float32[K, A, 2]
            actions, kinds = self.actions, planned_config(self.config).kinds
            table = np.stack([actions.commands_of(robot) for robot in kinds]) if len(kinds) > 1 else actions.table[None]
            passages = passages_of(self._floor)
        self._worlds = Worlds(
            self._planned, self.routes, self.arcs, self._commands, people.persons, people.ways,
            None if shifts is None else shifts.limits, deviation.bodies, deviation.errors, self._stamps,
            self.steps, self.truncated, self.terminated, self._waiting, self._paths, self._choices,
            self.observation, self.reward_terms, self.reward,
        )  # fmt: skip
        self.setup = Setup(
            self._features,
            Equipment(self.layout.starts, self._rays, table, self._weights, self._zones, passages),
            Vehicles(*self._limits), Vehicles(self._true_params, self._true_kinds), self._floor,
        )  # fmt: skip

    @property
    def worlds(self) -> Worlds:
        """The worlds' arrays; a longer route replaces the array of routes."""
        if self._worlds.routes is not self.dispatcher.routes:
            self._worlds = self._worlds._replace(routes=self.dispatcher.routes)
        return self._worlds

    def observe_into(self, observation: NDArray[np.float32]) -> None:
        """Write observations into this array [B, N, D] from now on; the previous one is not touched again."""
        wanted = observation.shape == self.observation.shape and observation.dtype == np.float32
        if not (wanted and observation.flags.carray):
            raise ConfigError(f"the array to observe into must be a contiguous float32{list(self.observation.shape)}")
        self.observation = observation
        self._collect()

    @property
    def routes(self) -> NDArray[np.float32]:
        """Way-points float32[B, N, R, 2] [m], of which state.route_points are valid. Do not keep it: it is replaced."""
        return self.dispatcher.routes

    @property
    def route_book(self) -> RouteBook:
        """The source of routes; can be replaced by that of a simulator with the same floor, planner and lanes."""
        return self.dispatcher.book

    @route_book.setter
    def route_book(self, book: RouteBook) -> None:
        self.dispatcher.book = book

    @property
    def reward_weights(self) -> RewardWeights:
        """The weights of the reward; can be set at any time (for schedules)."""
        return self._reward_weights

    @reward_weights.setter
    def reward_weights(self, weights: RewardWeights) -> None:
        if not isinstance(weights, RewardWeights):
            raise ConfigError(f"reward_weights={shown(weights)} must be of type RewardWeights")
        self._reward_weights = weights
        self._weights[:] = weight_vector(weights)

    @property
    def cruise_action(self) -> NDArray[Any]:
        """One robot's action that drives along the route at full speed (raw: no command at all)."""
        return self.actions.cruise

    def seconds(self, world: int) -> float:
        """Simulated time [s] since the world's reset."""
        return int(self.steps[world]) * self.config.action_repeat * self.config.time_step

    def reset(self, seed: given.Seeds = None, assignments: Sequence[Assignment] | None = None) -> NDArray[np.float32]:
        """Start all worlds anew and return the observation.

        seed: an int (world b draws from SeedSequence([seed, b])), one int a world (each then equals a single world
        reset with that int), or None (each world begins the next episode of its last seed). assignments: the robots and
        first goals of each world, if they are not drawn.
        """
        if assignments is not None:
            check_assignments(assignments, self.num_worlds, self.num_agents, self.grid)
        for world, entropy in enumerate(given.seeds_of(seed, self.num_worlds)):
            self._reset_world(world, entropy, assignments[world] if assignments else None)
        self._show()
        self._observe()
        return self.observation

    def reset_world(self, world: int, seed: int | None = None) -> None:
        """Start one world anew; its row of `observation` is updated. seed None: the next episode of its last seed."""
        self.reset_worlds([world], None if seed is None else [seed])

    def reset_worlds(self, worlds: Sequence[int], seeds: Sequence[int] | None = None) -> None:
        """Start some worlds anew as `reset_world` does, and update their rows of `observation`."""
        for world, entropy in zip(worlds, given.seeds_of(seeds, len(worlds)), strict=True):
            self._reset_world(world, entropy)
        self._show()
        self._observe(list(worlds))

    def _reset_world(self, world: int, entropy: list[int] | None, assignment: Assignment | None = None) -> None:
        self.draws.begin(world, entropy)
        self.begin_world(world, entropy, assignment)

    def begin_world(self, world: int, entropy: list[int] | None, assignment: Assignment | None = None) -> None:
        """Begin a world's episode by the key of its draws, without observing it.

        entropy: of its shift's generator and its people's; None: these go on.
        """
        robots = self._planned[world]
        self._stamps[world] = self._commands[:, world] = self.steps[world] = 0
        self.arrivals = [arrival for arrival in self.arrivals if arrival.world != world]
        self.truncated[world] = self.terminated[world] = False
        self.people.leave(world)
        self.dispatcher.begin(world, entropy, assignment, self._floor)
        self.losses.left[world] = 0
        self.people.begin(world, entropy, robots)
        if self.robots is not self._planned:
            begin_errors(world, self.draws.keys, self.deviation.walk, self.deviation.bodies, robots)

    def _show(self) -> None:
        """Update the robots' true poses if they differ from the plan."""
        if self.robots is not self._planned:
            self.robots[...] = self._planned
            self.robots["motion"] = self.deviation.bodies["motion"]

    def put(self, pose: ArrayLike, speed: ArrayLike) -> NDArray[np.bool_]:
        """Put robots at poses float[B, N, 3] (x [m], y [m], heading [rad]) with speeds float[B, N] [m/s], or one for
        all, beside their routes, and observe. Call after a reset.

        Returns bool[B]: whether no body of a world touches anything. Raises ConfigError for numbers that are not
        finite, front axles off the floor, and speeds beyond a robot's limits.
        """
        placed = poses("pose", pose, (self.num_worlds, self.num_agents, 3), self.grid)
        driven = speeds(speed, self.num_worlds, self.config.robots)
        free = put_all(self._planned, self.routes, placed, driven, self._limits, self._floor)
        if self.robots is not self._planned:
            for world in range(self.num_worlds):
                place_bodies(self.deviation.bodies[world], self._planned[world])
            self._show()
        self._observe()
        return free

    def break_down(self, world: int, robot: int) -> None:
        """Take a robot out of service until its world's reset: it brakes and then stands."""
        self.robots["task"]["alive"][world, robot] = self._planned["task"]["alive"][world, robot] = 0
        self.terminated[world, robot] = True
        if self.dispatcher.shifts is not None:
            self.dispatcher.shifts[world].break_down(robot)

    def step(self, actions: ArrayLike) -> NDArray[np.float32]:
        """Advance all worlds by one env step (action_repeat physics steps) and return the observation.

        actions: int[B, N] of a discrete config, or preferences float[B, N, A] (preferences.py); else float[B, N, 2]
        in [-1, 1] (clipped). Raises ActionError for another shape, values out of range or not finite.
        """
        if len(self._commands) > 1:
            self._commands[1:] = self._commands[:-1]
        self.actions.decode(actions, self._commands[0], self._choices)
        drawn = 0, self.num_worlds, self.draws.keys, self.steps
        if self.losses.occur:
            draw_silent(*drawn, self.losses, self._planned)
        if self.robots is not self._planned:
            draw_errors(*drawn, self.deviation.walk, self.deviation.errors)
        arrivals = sum(self._each(self._advance))
        self.people.send_on(self._planned)
        arrived = np.argwhere(self._planned["events"]["arrived"] != 0).tolist() if arrivals else []
        self.arrivals = self.dispatcher.arrive(self.steps, arrived)
        rerouted = self.dispatcher.work_on(self.steps) + self.dispatcher.reroute(self.steps)
        if self.dispatcher.all_look or arrivals or rerouted:
            self._look(slice(None) if self.dispatcher.all_look else rerouted)
        self._show()
        self._tell(slice(None))
        return self.observation

    def _tell(self, worlds: list[int] | slice) -> None:
        """Write the slices of the observations that no kernel writes."""
        if self.dispatcher.shifts is not None:
            self.dispatcher.shifts.write_needs(self.observation, self.layout.slices["needs"])
        if self._extra is not None:
            self._extra.write(self, worlds)

    def _call(self, kernel: Callable[..., Any], *numbers: int) -> Any:
        """Call a kernel of the step; the types of its arguments never change."""
        arguments = *numbers, self.worlds, self.setup, self._scratch.step
        if kernel not in self._compiled:
            self._compiled[kernel] = compiled_for(kernel, *arguments)
        return self._compiled[kernel](*arguments)

    def _advance(self, begin: int, end: int) -> int:
        """Advance the worlds from `begin` to before `end`; return the number of arrivals.

        Observes worlds without arrivals, unless all robots look for better routes first.
        """
        worlds = self.worlds
        if self._decides and self._call(local_activation.assign_right_of_way, begin, end):
            deadlock_recovery.resolve_deadlocks(begin, end, worlds, self.search_setup, self._scratch.search)
        observe = 0 if self.dispatcher.all_look else step.OBSERVE
        did: tuple[int, int] = self._call(step.run, begin, end, step.ADVANCE | observe)
        arrivals, seeking = did
        if seeking:
            recovery.seek(begin, end, worlds, self.search_setup, self._scratch.search, self._features.stopping)
            if observe:
                self._call(step.run, begin, end, observe)
        return arrivals

    @property
    def search_setup(self) -> recovery.SearchSetup:
        """What the searches of manoeuvres are given."""
        metrics, budget = turning_metrics(self._every_kind), recovery.QUICK if self.config.quick_searches else (MOST, 1)
        return recovery.SearchSetup(*self._limits, metrics, self._floor, *budget)

    def _each(self, work: Callable[[int, int], int]) -> list[int]:
        """Call work(begin, end) for all worlds, in parts."""
        if self.num_worlds > 1 and self.num_worlds * self.num_agents >= PARALLEL_FROM and get_num_threads() > 1:
            return side_by_side(work, self._parts)
        return [work(*part) for part in self._blocks]

    def _observe(self, worlds: list[int] | slice = slice(None)) -> None:
        """Observe these worlds, and all that wait for it."""
        self._look(worlds)
        self._tell(worlds)

    def _look(self, worlds: list[int] | slice) -> None:
        self._waiting[worlds] = 1
        self._each(lambda begin, end: self._call(step.run, begin, end, step.OBSERVE_WAITING))

    def episode_metrics(self, world: int = 0) -> dict[str, float]:
        """Return the row of numbers of a world's episode so far (see metrics.episode_row, and Tasks.cut_off)."""
        row = metrics.episode_row(self.robots[world], self.seconds(world), self.config, self.people.persons[world])
        row |= {"cut_off": self.dispatcher.tasks[world].cut_off()}
        return row | self.dispatcher.work_row(world)

    def jams(self) -> Jams:
        """Return the robots for which each standing robot waits, the wait cycles and the stages (waits.jams_of)."""
        return jams_of(self.robots, self.routes, *self._limits)

    def global_state(self, world: int = 0) -> NDArray[np.float32]:
        """Return float32[N * 8] for centralised critics: per robot x, y, goal x, y / the map's longer side,
        cos and sin of the heading, speed / max_speed, steering / max_steering.
        """
        side = max(self.grid.shape) * self.grid.cell_size
        return state.global_view(self.robots[world], side, self.config)
