"""Simulator: the one stateful object around the kernels: config, random generators, state arrays, routes, tasks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.errors import ConfigError, shown
from warehouse_env.kernel import compiled_for
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.loading import load_floor
from warehouse_env.observation import observation_layout
from warehouse_env.planning.plan import Planner
from warehouse_env.portable import Portable
from warehouse_env.routes.book import RouteBook
from warehouse_env.simulation import given, state, step
from warehouse_env.simulation.actions import ActionDecoder
from warehouse_env.simulation.driver.manoeuvre import ARCS
from warehouse_env.simulation.driver.scratch import make_search_scratch
from warehouse_env.simulation.driver.turning import turning_metrics
from warehouse_env.simulation.physics.buckets import bucket_grid
from warehouse_env.simulation.physics.deviation import Deviation, errs, planned_config
from warehouse_env.simulation.physics.floor import floor_of
from warehouse_env.simulation.physics.people import People
from warehouse_env.simulation.physics.poses import poses, speeds
from warehouse_env.simulation.physics.zones import zones_of
from warehouse_env.simulation.record import metrics
from warehouse_env.simulation.senses.messages import Messages
from warehouse_env.simulation.senses.rewards import REWARD_TERMS, weight_vector
from warehouse_env.simulation.senses.sensing import unit_vectors
from warehouse_env.simulation.tasks.assignment import Assignment, check_assignments
from warehouse_env.simulation.tasks.dispatch import ROUTE_BLOCK, Dispatcher
from warehouse_env.simulation.tasks.orders import Order
from warehouse_env.simulation.tasks.placement import Limits, put_all
from warehouse_env.simulation.tasks.tasks import Arrival
from warehouse_env.simulation.traffic import deadlock_recovery, decision, recovery
from warehouse_env.simulation.traffic.audit import raise_fault
from warehouse_env.simulation.traffic.jams import Jams, jams_of
from warehouse_env.simulation.traffic.path_ahead import COLUMNS, POSES
from warehouse_env.simulation.worlds import Equipment, Features, Pool, Scratch, Setup, Vehicles, Worlds, make_scratch
from warehouse_env.threads import MOST_THREADS, get_num_threads, side_by_side

PARALLEL_FROM = 256  # robots in all from which waking other threads pays
_PARTS = 2  # of the worlds for each thread: who is done early, or has a core for itself, does more of them
_LEAST, _MOST = 32, 1024  # robots in a part: of more, what a step leaves in a core's cache is gone when it observes


def _parts(worlds: int, share: int) -> list[tuple[int, int]]:
    """Return the parts of `share` worlds into which so many fall: the first of each, and the first that is none."""
    return [(first, min(first + share, worlds)) for first in range(0, worlds, share)]


class Simulator(Portable):
    """B independent worlds of N robots in lock-step.

    Outputs are the simulator's own arrays, overwritten by the next step: `observation` float32[B, N, D], `reward`
    float32[B, N], `reward_terms` float32[B, N, T] in the order of REWARD_TERMS, `terminated` bool[B, N] (not alive
    any more), `truncated` bool[B] (max_steps reached; stepping on is allowed), the views `state` and `events`, and
    `arrivals`, the tasks finished with the last step.
    """

    bound = (
        "state", "events", "_floor", "_rays", "_zones", "_compiled",
        "_worlds", "setup", "_scratches", "_searches",
    )  # fmt: skip

    def __init__(
        self,
        config: EnvConfig,
        num_worlds: int = 1,
        *,
        grid: GridMap | None = None,
        planner: Planner | None = None,
        routes: RouteBook | None = None,
        orders: Sequence[Order] | None = None,
    ) -> None:
        """Build the worlds; call `reset` before the first step.

        grid, planner, orders: instead of those that the config names; routes: a RouteBook shared with other simulators.
        """
        given.check_parts(config, grid, planner, routes)
        num_worlds = given.check_count("num_worlds", num_worlds)
        self.config, self.num_worlds, self.num_agents = config, num_worlds, config.num_agents
        self.grid = routes.grid if routes is not None else load_floor(config, grid)
        if routes is None:
            from warehouse_env.planning import make_planner

            planner = planner if planner is not None else make_planner(config.planner)
            routes = RouteBook(self.grid, planner, keep_right=config.keep_right, wider=config.widest_body.wider)
        given.check_pace(config, self.grid.cell_size)
        planned = planned_config(config)
        given.check_stop(config, state.stop_samples(planned))
        self.layout = observation_layout(config)
        each = state.ROBOT.itemsize + 8 * ROUTE_BLOCK
        cells = self.grid.occupied.size
        given.check_memory(num_worlds, config.num_agents, self.layout.size, each, config.people, cells)
        self._every_kind = state.every_kind(planned, self.grid.cell_size, config.kinds)
        self._params = self._every_kind[:1].copy()
        self._kinds = self._every_kind[list(config.kind_of)] if config.fleet else None
        self._limits: Limits = self._params, self._kinds
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (self.layout.size,), np.float32)
        self.actions = ActionDecoder(planned)
        self.action_space = self.actions.space
        self._weights = weight_vector(config.reward)
        self._reward_weights = config.reward
        self._planned = np.zeros((num_worlds, config.num_agents), dtype=state.ROBOT)
        self.robots = self._planned.copy() if errs(config) else self._planned  # where they are, in truth
        self.people = People(planned, self.grid, num_worlds)
        self.dispatcher = Dispatcher(planned, routes, self._planned, self.people.persons, self._limits, orders)
        self._deviation = Deviation(config, num_worlds)
        self._messages = Messages(config, num_worlds)
        self._make_arrays(planned)

    def _make_arrays(self, planned: EnvConfig) -> None:
        b, n, p, self._decides = self.num_worlds, self.num_agents, self._params, self.config.traffic_spec.right_of_way
        self.arcs = np.zeros((b, n, ARCS, 2), dtype=np.float32)  # [m], [rad]; the robots' manoeuvres
        self._paths = np.zeros((b, n + 1 if self._decides else 0, POSES, COLUMNS), dtype=np.float32)
        self.observation = np.zeros((b, n, self.layout.size), dtype=np.float32)
        self.reward = np.zeros((b, n), dtype=np.float32)
        self.reward_terms = np.zeros((b, n, len(REWARD_TERMS)), dtype=np.float32)
        self.terminated = np.zeros((b, n), dtype=np.bool_)
        self.truncated = np.zeros(b, dtype=np.bool_)
        self.steps = np.zeros(b, dtype=np.int64)  # env steps since each world's reset
        self.arrivals: list[Arrival] = []
        said = math.ceil(int(p["latency"][0]) / self.config.action_repeat)  # env steps ago, what comes into force now
        self._commands = np.zeros((1 + said, b, n, 2), dtype=np.float32)
        self._choices = self.actions.no_choices(b, n)
        reach = float(p["pair_range"][0])
        widest = float(p["widest"][0])
        self._stamps = np.zeros((b, n, state.most_near(n, self.config), 2), dtype=np.int32)
        rows, columns = self.grid.shape
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
        self._true_params, self._true_kinds = self._limits  # of the bodies, where these are not what is planned
        if self.robots is not self._planned:
            self._true_params = state.parameters_of(self.config, size)
            self._true_kinds = state.kinds_of(self.config, size)
        for records in (p, self._kinds, self._true_params, self._true_kinds):
            if records is not None:
                for name, value in shared.items():
                    records[name] = value
        self._waiting = np.zeros(b, dtype=np.int32)
        self._faults = np.zeros((b, 3), dtype=np.int32)
        self._features = Features.of(self.config)
        most, least = max(_MOST // n, 1), math.ceil(_LEAST / n)
        self._blocks = _parts(b, most)
        self._parts = _parts(b, max(min(math.ceil(b / (_PARTS * MOST_THREADS)), most), least))
        self._bind()

    def _bind(self) -> None:
        """Make the views and the floor, and keep the kernels' arguments ready."""
        self.state, self.events = state.state_of(self.robots), state.events_of(self.robots)
        self._floor = floor_of(self.grid, self.config.sensor.lidar_range)
        self._zones = zones_of(self.grid, planned_config(self.config))
        self._rays = unit_vectors(self.config.sensor.rays)
        self._compiled: dict[Callable[..., Any], Callable[..., Any]] = {}  # kernels, once a step asks for them
        self._scratches = Pool(self.make_scratch)
        self._searches = Pool(lambda: make_search_scratch(self.num_agents, self.config.people, POSES))
        self._collect()

    def _collect(self) -> None:
        """Keep the kernels' arguments ready: collecting them takes longer than a small world's step."""
        shifts, people, deviation, table = self.dispatcher.shifts, self.people, self._deviation, None
        if self.config.sensor.predictions:  # what discrete actions mean to each kind of robots, float32[K, A, 2]
            actions, kinds = self.actions, planned_config(self.config).kinds
            table = np.stack([actions.commands_of(robot) for robot in kinds]) if len(kinds) > 1 else actions.table[None]
        self._worlds = Worlds(
            self._planned, self.routes, self.arcs, self._commands, people.persons, people.ways,
            None if shifts is None else shifts.limits, deviation.bodies, deviation.errors, self._stamps,
            self.steps, self.truncated, self.terminated, self._waiting, self._faults, self._paths, self._choices,
            self.observation, self.reward_terms, self.reward,
        )  # fmt: skip
        self.setup = Setup(
            self._features,
            Equipment(self.layout.starts, self._rays, table, self._weights, self._zones),
            Vehicles(*self._limits), Vehicles(self._true_params, self._true_kinds), self._floor,
        )  # fmt: skip

    def make_scratch(self) -> Scratch:
        """Return scratch for one kernel call at a time."""
        return make_scratch(self.setup, self.num_agents, self._decides)

    @property
    def worlds(self) -> Worlds:
        """The worlds' arrays; that of the routes is another one once a longer route has come."""
        if self._worlds.routes is not self.dispatcher.routes:
            self._worlds = self._worlds._replace(routes=self.dispatcher.routes)
        return self._worlds

    def observe_into(self, observation: NDArray[np.float32]) -> None:
        """Write observations into this array [B, N, D] from now on; the last one stays as it is, its holder's own."""
        wanted = observation.shape == self.observation.shape and observation.dtype == np.float32
        if not (wanted and observation.flags.carray):
            raise ConfigError(f"a whole array float32{list(self.observation.shape)} is needed to observe into")
        self.observation = observation
        self._collect()

    @property
    def routes(self) -> NDArray[np.float32]:
        """Way-points float32[B, N, R, 2] [m], of which state.route_points are valid; not to keep, as it grows."""
        return self.dispatcher.routes

    @property
    def route_book(self) -> RouteBook:
        """Where routes come from; may be replaced by another simulator's for the same floor, planner and lanes."""
        return self.dispatcher.book

    @route_book.setter
    def route_book(self, book: RouteBook) -> None:
        self.dispatcher.book = book

    @property
    def reward_weights(self) -> RewardWeights:
        """The weights in force; may be set at any time (for schedules)."""
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

    def reset(self, seed: int | Sequence[int] | None = None) -> NDArray[np.float32]:
        """Start all worlds anew and return the observation.

        seed: an int (world b draws from SeedSequence([seed, b])), one int a world (each then equals a single world
        reset with that int), or None (each world goes on with its own generator).
        """
        return self._reset([None] * self.num_worlds, seed)

    def reset_to(
        self, assignments: Sequence[Assignment], seed: int | Sequence[int] | None = None
    ) -> NDArray[np.float32]:
        """Start all worlds anew as `reset` does, robots and first goals of each as its assignment says."""
        check_assignments(assignments, self.num_worlds, self.num_agents, self.grid)
        return self._reset(assignments, seed)

    def _reset(self, assignments: Sequence[Assignment | None], seed: int | Sequence[int] | None) -> NDArray[np.float32]:
        for world, entropy in enumerate(given.seeds_of(seed, self.num_worlds)):
            self._reset_world(world, entropy, assignments[world])
        self._show()
        self._observe()
        return self.observation

    def reset_world(self, world: int, seed: int | None = None) -> None:
        """Start one world anew; its row of `observation` is updated. seed None: its generator goes on."""
        self._reset_world(world, None if seed is None else [given.whole_seed(seed), 0])
        self._show()
        self._observe(world)

    def reset_worlds(self, worlds: Sequence[int]) -> None:
        """Start some worlds anew, and update their rows of `observation`; their generators go on."""
        for world in worlds:
            self._reset_world(world, None)
        self._show()
        self._observe(list(worlds))

    def _reset_world(self, world: int, entropy: list[int] | None, assignment: Assignment | None = None) -> None:
        robots = self._planned[world]
        robots[...] = np.zeros((), dtype=state.ROBOT)
        self._stamps[world] = self._faults[world] = self._commands[:, world] = self.steps[world] = 0
        self.arrivals = [arrival for arrival in self.arrivals if arrival.world != world]
        self.truncated[world] = self.terminated[world] = False
        robots["task"]["alive"] = 1
        robots["events"]["gap"] = robots["totals"]["min_gap"] = state.GAP_HORIZON
        robots["shield"]["vetoed_by"] = robots["traffic"]["yields_to"] = state.NOBODY
        self.people.leave(world)
        self.dispatcher.begin(world, entropy, assignment, self._floor)
        self._messages.begin(world, entropy)
        self.people.begin(world, entropy, robots)
        robots["clocks"]["anchor_x"], robots["clocks"]["anchor_y"] = robots["motion"]["x"], robots["motion"]["y"]
        if self.robots is not self._planned:
            self._deviation.begin(world, entropy, robots)

    def _show(self) -> None:
        """Show outsiders where the bodies are, where that is not as planned."""
        if self.robots is not self._planned:
            self._deviation.show(self.robots, self._planned)

    def put(self, pose: ArrayLike, speed: ArrayLike) -> NDArray[np.bool_]:
        """Put robots at poses float[B, N, 3] (x [m], y [m], heading [rad]) with speeds float[B, N] [m/s], or one for
        all, beside their routes, and observe. Call after a reset.

        Returns bool[B]: whether no body of a world touches anything. ConfigError for what is not finite, for a front
        axle off the floor, and for speeds beyond a robot's limits.
        """
        placed = poses("pose", pose, (self.num_worlds, self.num_agents, 3), self.grid)
        driven = speeds(speed, self.num_worlds, self.config.robots)
        free = put_all(self._planned, self.routes, placed, driven, self._limits, self._floor)
        if self.robots is not self._planned:
            for world in range(self.num_worlds):
                self._deviation.stand(world, self._planned[world])
            self._show()
        self._observe()
        return free

    def break_down(self, world: int, robot: int) -> None:
        """Take a robot out of service until its world's reset: it brakes, and stands in the others' way for good."""
        self.robots["task"]["alive"][world, robot] = self._planned["task"]["alive"][world, robot] = 0
        self.terminated[world, robot] = True
        if self.dispatcher.shifts is not None:
            self.dispatcher.shifts[world].break_down(robot)

    def step(self, actions: ArrayLike) -> NDArray[np.float32]:
        """Advance all worlds by one env step (action_repeat physics steps) and return the observation.

        actions: int[B, N] of a discrete config, or preferences float[B, N, A] (preferences.py); else float[B, N, 2]
        in [-1, 1] (clipped). ActionError if of another shape, out of range or not finite.
        """
        if len(self._commands) > 1:
            self._commands[1:] = self._commands[:-1]
        self.actions.decode(actions, self._commands[0], self._choices)
        self._messages.lose(self._planned)
        if self.robots is not self._planned:
            self._deviation.draw()
        arrivals = sum(self._each(self._advance))
        if self._features.checked:
            raise_fault(self._faults)
        self.people.send_on(self._planned)
        arrived = np.argwhere(self._planned["events"]["arrived"] != 0).tolist() if arrivals else []
        self.arrivals = self.dispatcher.arrive(self.steps, arrived)
        rerouted = self.dispatcher.work_on(self.steps) + self.dispatcher.reroute(self.steps)
        if self.dispatcher.all_look:
            self._observe()
        elif arrivals or rerouted:
            self._observe(rerouted)
        else:
            self._tell_needs()
        self._show()
        return self.observation

    def _tell_needs(self) -> None:
        """Write what robots are to know of their own work into their observations."""
        if self.dispatcher.shifts is not None:
            self.dispatcher.shifts.write_needs(self.observation, self.layout.slices["needs"])

    def _call(self, kernel: Callable[..., Any], *numbers: int, scratch: Scratch) -> Any:
        """Call a kernel of the step with numbers, and arguments that never change their types."""
        arguments = *numbers, self.worlds, self.setup, scratch
        if kernel not in self._compiled:
            self._compiled[kernel] = compiled_for(kernel, *arguments)
        return self._compiled[kernel](*arguments)

    def _advance(self, begin: int, end: int) -> int:
        """Advance the worlds from `begin` to before `end`, and observe those without arrivals; return how many.

        Where all robots look for better routes, a world waits with its observation until they have done so.
        """
        worlds, scratch = self.worlds, self._scratches.take()
        if self._decides and self._call(decision.assign_right_of_way, begin, end, scratch=scratch):
            search = self._searches.take()
            deadlock_recovery.resolve_deadlocks(begin, end, worlds, self.search_setup, search)
            self._searches.give_back(search)
        observe = 0 if self.dispatcher.all_look else step.OBSERVE
        did: tuple[int, int] = self._call(step.run, begin, end, step.ADVANCE | observe, scratch=scratch)
        arrivals, seeking = did
        if seeking:
            search = self._searches.take()
            recovery.seek(begin, end, worlds, self.search_setup, search, self._features.stopping)
            self._searches.give_back(search)
            if observe:
                self._call(step.run, begin, end, observe, scratch=scratch)
        self._scratches.give_back(scratch)
        return arrivals

    @property
    def search_setup(self) -> recovery.SearchSetup:
        """What the searches of manoeuvres are given."""
        return recovery.SearchSetup(*self._limits, turning_metrics(self._every_kind), self._floor)

    def _many(self) -> bool:
        return self.num_worlds > 1 and self.num_worlds * self.num_agents >= PARALLEL_FROM and get_num_threads() > 1

    def _each(self, work: Callable[[int, int], int]) -> list[int]:
        """Do some work from one world to before another for all worlds, in parts."""
        return side_by_side(work, self._parts) if self._many() else [work(*part) for part in self._blocks]

    def _observe(self, worlds: int | list[int] | slice = slice(None)) -> None:
        """Observe these worlds, and those that wait for it."""
        self._waiting[worlds] = 1
        self._each(self._observe_waiting)
        self._tell_needs()

    def _observe_waiting(self, begin: int, end: int) -> int:
        scratch = self._scratches.take()
        self._call(step.run, begin, end, step.OBSERVE_WAITING, scratch=scratch)
        self._scratches.give_back(scratch)
        return 0

    def episode_metrics(self, world: int = 0) -> dict[str, float]:
        """Return the row of numbers of a world's episode so far (see metrics.episode_row, and Tasks.cut_off)."""
        row = metrics.episode_row(self.robots[world], self.seconds(world), self.config, self.people.persons[world])
        row |= {"cut_off": self.dispatcher.tasks[world].cut_off()}
        return row | self.dispatcher.work_row(world)

    def jams(self) -> Jams:
        """Return whom each standing robot waits for, the wait cycles, and the stages (jams.jams_of)."""
        return jams_of(self.robots, self.routes, *self._limits)

    def global_state(self, world: int = 0) -> NDArray[np.float32]:
        """Return float32[N * 8] for centralised critics: per robot x, y, goal x, y / the map's longer side,
        cos and sin of the heading, speed / max_speed, steering / max_steering.
        """
        side = max(self.grid.shape) * self.grid.cell_size
        return state.global_view(self.robots[world], side, self.config)
