"""DeviceSimulator: B worlds whose step and resets run on a GPU, with the bits of the Simulator.

The host keeps a Simulator of one world, for its setup, and makes the routes that no robot has asked for before.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.errors import ActionError, ConfigError, check_count
from warehouse_env.routes.route_table import RouteTable
from warehouse_env.simulation import state
from warehouse_env.simulation.device import drivers
from warehouse_env.simulation.device.actions import TensorDecoder
from warehouse_env.simulation.device.lines import LinesOnDevice, shown
from warehouse_env.simulation.device.live import LiveOnHost
from warehouse_env.simulation.device.memory import bytes_of, field_on_device, mapped, memory_of, tensor_of
from warehouse_env.simulation.draws import Draws
from warehouse_env.simulation.driver.scratch import make_search_scratch
from warehouse_env.simulation.given import Seeds, seeds_of
from warehouse_env.simulation.physics.deviation import BODY, place_bodies
from warehouse_env.simulation.physics.poses import poses, speeds
from warehouse_env.simulation.record.metrics import episode_rows
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks import beginning
from warehouse_env.simulation.tasks.assignment import Assignment, check_assignments
from warehouse_env.simulation.tasks.dispatch import no_room, width_of
from warehouse_env.simulation.tasks.goals import GoalState
from warehouse_env.simulation.tasks.placement import put_all
from warehouse_env.simulation.tasks.tasks import Arrival
from warehouse_env.simulation.traffic.live import live_planner
from warehouse_env.simulation.traffic.path_ahead import POSES
from warehouse_env.simulation.worlds import Setup, Worlds, make_scratch

MANY = 10_000  # robots placed at once that will soon need all routes
SEARCHING, SEEING = 2**32, 2**16  # bytes of scratch for searches at most, and threads that plan and observe

# What a config may not have on a device, and how an error names it
_ABSENT: tuple[tuple[str, Callable[[EnvConfig], object]], ...] = (
    ("mixed fleets that stop at poses", lambda config: bool(config.fleet) and config.arrival == "pose"),
    ("extra sensors", lambda config: config.sensor.extra is not None),
    ("own tasks", lambda config: config.tasks not in ("lifelong", "one_shot")),
    ("people", lambda config: config.people > 0),
    ("orders, services and batteries", lambda config: config.works),
    ("live routes by pf_aco", lambda config: config.traffic_spec.routes and live_planner(config).name == "pf_aco"),
    (
        "live routes of one-shot tasks or to poses",
        lambda config: config.traffic_spec.routes and (config.tasks == "one_shot" or config.arrival == "pose"),
    ),
)


def check_device(config: EnvConfig) -> None:
    """ConfigError that names what a config has and a device has not."""
    missing = [name for name, has in _ABSENT if has(config)]
    if missing:
        raise ConfigError(
            f"a device does not simulate {', '.join(missing)} yet: leave that out (for instance "
            "traffic=TrafficSpec(shield=True); in commands, --traffic rules:routes=false), or use the CPU"
        )


class DeviceSimulator:
    """B independent worlds of N robots in lock-step, on a device.

    `observation` float32[B, N, D], `reward` float32[B, N], `reward_terms` float32[B, N, T] are tensors on the device,
    overwritten by the next step. `truncated` bool[B] (max_steps reached) and `steps` int64[B] are the host's.
    """

    def __init__(self, config: EnvConfig, num_worlds: int = 1, *, device: str = "cuda", **parts: Any) -> None:
        """Build the worlds; call `reset` before the first step.

        device: as torch names it, "cpu" too; parts: grid, planner or routes, as the Simulator takes them. ConfigError
        for a device that cannot be used, and for what it does not simulate.
        """
        check_device(config)
        self._memory = memory_of(device)
        self.host = Simulator(config, 1, **parts)
        self.num_worlds = check_count("num_worlds", num_worlds)
        self.config, self.num_agents, self.device = config, config.num_agents, self._memory.device
        self.steps, self.truncated = np.zeros(num_worlds, np.int64), np.zeros(num_worlds, np.bool_)
        self._draws, self._cut_off = Draws(num_worlds), np.full(num_worlds, np.nan)
        self._tensors, self._views = dict[str, torch.Tensor](), dict[str, Any]()
        self._lines = LinesOnDevice(self._memory)
        self._live = LiveOnHost(self.host, self._draws, self._memory) if config.traffic_spec.routes else None
        self._allocate()

    @property
    def terminated(self) -> torch.Tensor:
        """Whether each robot has terminated, bool[B, N] on the device."""
        return self._tensors["terminated"]

    def all_terminated(self) -> NDArray[np.bool_]:
        """Return bool[B]: whether all robots of each world have terminated."""
        if self.config.tasks == "lifelong" and not self.config.terminate_on_collision:
            return np.zeros(self.num_worlds, np.bool_)
        ended: NDArray[np.bool_] = self.terminated.all(dim=1).cpu().numpy()
        return ended

    @property
    def robots(self) -> torch.Tensor:
        """The robots' records on the device, uint8[B, N, bytes of a ROBOT], at their true poses."""
        planned, size = self._tensors["robots"], state.MOTION.itemsize
        if not self._errs:
            return planned
        return torch.cat((self._tensors["actual"][..., :size], planned[..., size:]), -1)  # both begin with the motion

    @property
    def reward_weights(self) -> RewardWeights:
        """The weights of the reward; can be set at any time (for schedules)."""
        return self.host.reward_weights

    @reward_weights.setter
    def reward_weights(self, weights: RewardWeights) -> None:
        self.host.reward_weights = weights
        self._weights.copy_(tensor_of(self.host.setup.equipment.weights))

    def _arrays(self) -> dict[str, NDArray[Any] | None]:
        """Return the arrays of the host's world that the device has for each world, by name."""
        host = self.host
        drawn = {"keys": host.draws.keys, "left": host.losses.left, "drift": host.deviation.walk.drift}
        booked = {"wanted": host.dispatcher.wanted, "booked": host.dispatcher.booked}
        return host.worlds._asdict() | drawn | host.dispatcher.goals._asdict() | booked

    def _allocate(self) -> None:
        host, memory, count = self.host, self._memory, self.num_worlds
        for name, array in self._arrays().items():
            self._views[name] = None
            if array is not None:
                axis, shape = int(name == "commands"), list(array.shape)
                shape[axis] *= count
                self._tensors[name], self._views[name] = memory.allocate(shape, array.dtype)
        self._weights, weights = memory.allocate(host.setup.equipment.weights.shape, host.setup.equipment.weights.dtype)
        self._go, self._views["go"] = memory.allocate((1,), np.dtype(np.int64))
        self._status, self._views["status"] = memory.allocate((count,), np.dtype(np.int32))
        self.reward_weights, self._fresh = host.reward_weights, tensor_of(state.fresh_robot()).to(self.device)
        setup = mapped(host.setup, memory.constant)
        setup = setup._replace(equipment=setup.equipment._replace(weights=weights))
        robots = count * self.num_agents
        self._threads, self._seeing = memory.threads(count), memory.threads(min(robots, SEEING))
        self._decides, self._loses = self.config.traffic_spec.right_of_way, host.losses.occur
        self._errs = setup.features.erring is not None
        scratch = make_scratch(host.setup, self.num_agents, self._decides)
        nodes, poses = host.search_setup.nodes, POSES if self._decides else 1
        searches = make_search_scratch(self.num_agents, poses=poses, nodes=nodes)
        most = SEARCHING // bytes_of(searches)
        self._few, self._searching = memory.threads(min(count, most)), memory.threads(min(robots, most))
        self._batch = drivers.Batch(
            Worlds(**{name: self._views[name] for name in Worlds._fields}), setup,
            mapped(scratch, lambda array: memory.scratch(count, array)),
            mapped(make_scratch(host.setup, 0, False).sights, lambda array: memory.scratch(self._seeing, array)),
            mapped(host.search_setup, memory.constant),
            mapped(searches, lambda array: memory.scratch(self._searching, array)), self._views["go"],
        )  # fmt: skip
        self._noise, self._work = self._make_noise(), self._make_work(setup)
        self.observation, self.reward = self._tensors["observation"], self._tensors["reward"]
        self.reward_terms, self._decoder = self._tensors["terms"], TensorDecoder(self.config, host.actions, memory)

    def _make_noise(self) -> drivers.Noise:
        host, views = self.host, self._views
        bounds = self._memory.constant(host.deviation.walk.bounds)
        return drivers.Noise(
            views["keys"], views["steps"], host.losses._replace(left=views["left"]), views["robots"],
            host.deviation.walk._replace(drift=views["drift"], bounds=bounds), views["errors"], views["actual"],
            views["waiting"], views["go"],
        )  # fmt: skip

    def _make_work(self, setup: Setup) -> drivers.Work:
        views, memory, dispatcher = self._views, self._memory, self.host.dispatcher
        tasks = dispatcher.arrays(self._lines.update(dispatcher.route_table))._replace(
            goals=GoalState(*(views[name] for name in GoalState._fields)),
            **{name: views[name] for name in ("robots", "routes", "keys", "wanted", "booked")},
        )
        floor = mapped(tasks.floor, memory.constant)
        orders = mapped(dispatcher.make_scratch()[0], lambda array: memory.scratch(self._few, array))
        return drivers.Work(
            views["steps"], tasks._replace(floor=floor), views["status"], orders, setup.planned, setup.floor,
            views["go"],
        )  # fmt: skip

    def reset(self, seed: Seeds = None, assignments: Sequence[Assignment] | None = None) -> torch.Tensor:
        """Start all worlds anew as `Simulator.reset` does, and return the observation; given goals must be cells."""
        if assignments is not None:
            check_assignments(assignments, self.num_worlds, self.num_agents, self.host.grid)
            if any(one.goal.dtype.kind == "f" for one in assignments):
                raise ConfigError("goals on a device must be cells, two whole numbers each; points, poses need the CPU")
        for world, entropy in enumerate(seeds_of(seed, self.num_worlds)):
            self._draws.begin(world, entropy)
        self._begin(list(range(self.num_worlds)), assignments or [None] * self.num_worlds)
        return self.observation

    def reset_worlds(self, worlds: list[int], seeds: Sequence[int] | None = None) -> None:
        """Start some worlds anew, with a seed each as `Simulator.reset_world` takes it, or with their next episodes."""
        for world, entropy in zip(worlds, seeds_of(seeds, len(worlds)), strict=True):
            self._draws.begin(world, entropy)
        self._begin(worlds, [None] * len(worlds))

    def _begin(self, worlds: list[int], assignments: Sequence[Assignment | None]) -> None:
        """Begin episodes by the keys of the draws."""
        if not worlds:
            return
        tensors, rows = self._tensors, torch.as_tensor(worlds, dtype=torch.int64, device=self.device)
        self.steps[worlds], self.truncated[worlds] = 0, False
        tensors["keys"][rows] = tensor_of(self._draws.keys[worlds]).to(self.device)
        for name in ("stamps", "steps", "truncated", "terminated", "left"):
            tensors[name][rows] = 0
        tensors["commands"][:, rows] = 0
        tensors["robots"][rows] = self._fresh
        if self._live is not None:
            begun = self._live.begin(worlds, assignments)
            self._fit_routes(self._live.dispatcher.routes.shape[2])
            self._live.upload(begun, self._tensors)
        elif any(assignments) or not self.host.dispatcher.by_table:
            self._place_on_host(worlds, assignments)
        else:
            self._place(rows)
        tensors["waiting"][rows] = 1
        if self._errs:
            self._memory.launch(drivers.begin_errors, self._threads, self._noise)
        self._observe()

    def _observe(self) -> None:
        """Observe the worlds that wait for it."""
        self._memory.launch(drivers.survey, self._threads, self._batch)
        if self.config.sensor.predictions:
            self._memory.launch(drivers.plan, self._seeing, self._batch)
        self._memory.launch(drivers.observe, self._seeing, self._batch)
        self._tensors["waiting"].zero_()

    def _place(self, rows: torch.Tensor) -> None:
        """Place the robots of worlds by the kernel, which the host supplies with routes."""
        table = self.host.dispatcher.route_table
        table.trim()
        if len(rows) * self.num_agents >= MANY and self.config.arrival != "pose":
            self.host.dispatcher.book.make_all(shown)
        self._take_routes(table)
        self._status[rows] = beginning.TO_PLACE
        wants = True
        while wants:
            self._memory.launch(drivers.place, self._few, self._work)
            worst = int(self._status.min())
            if worst < 0:
                raise no_room(self.num_agents, -1 - worst, self.host.grid)
            wants = self._make_routes()

    def _make_routes(self) -> bool:
        """Make the routes that robots want; return whether there are any."""
        wanted = self._tensors["wanted"]
        keys = wanted[wanted != 0].cpu().numpy()
        if len(keys):
            table = self.host.dispatcher.route_table
            table.fill(keys, shown)
            self._take_routes(table)
        return len(keys) > 0

    def _take_routes(self, table: RouteTable) -> None:
        """Bring the device's table of routes up to date, and make room for its longest."""
        self._fit_routes(width_of(table.longest))
        lines = self._lines.update(table)
        if lines is not self._work.tasks.lines:
            self._work = self._work._replace(tasks=self._work.tasks._replace(lines=lines))

    def _fit_routes(self, width: int) -> None:
        held = self._tensors["routes"]
        if width > held.shape[2]:
            shape = (*held.shape[:2], width, 2)
            self._tensors["routes"], routes = self._memory.allocate(shape, np.dtype(np.float32))
            self._tensors["routes"][:, :, : held.shape[2]] = held
            self._batch = self._batch._replace(worlds=self._batch.worlds._replace(routes=routes))
            self._work = self._work._replace(tasks=self._work.tasks._replace(routes=routes))

    def _place_on_host(self, worlds: list[int], assignments: Sequence[Assignment | None]) -> None:
        """Place the robots of worlds by the host's own world, one after another."""
        host = self.host
        for world, assignment in zip(worlds, assignments, strict=True):
            host.draws.keys[0] = self._draws.keys[world]
            host.begin_world(0, None, assignment)
            self._fit_routes(host.routes.shape[2])
            arrays = {"robots": host.worlds.robots, **host.dispatcher.goals._asdict()}
            for name, array in arrays.items():
                self._tensors[name][world] = tensor_of(array[0]).to(self.device)
            self._tensors["routes"][world, :, : host.routes.shape[2]] = tensor_of(host.routes[0]).to(self.device)
            self._cut_off[world] = host.dispatcher.tasks[0].cut_off()

    def step(self, actions: torch.Tensor) -> torch.Tensor:
        """Advance all worlds by one env step and return the observation.

        actions: as `Simulator.step` takes them, on the device. ActionError as there.
        """
        self._go.copy_(self._decoder.decode(actions, self._tensors, self._batch.worlds))  # else nothing moves
        if self._errs or self._loses:
            self._memory.launch(drivers.draw, self._threads, self._noise)
        if self._decides:
            self._memory.launch(drivers.decide, self._threads, self._batch)
            self._memory.launch(drivers.resolve, self._few, self._batch)
        self._memory.launch(drivers.advance, self._threads, self._batch)
        self._memory.launch(drivers.search, self._searching, self._batch)
        self._give()
        self.steps += 1
        self.truncated[:] = self.steps >= self.config.max_steps
        self._tensors["waiting"].fill_(1)
        self._observe()
        return self.observation

    def _give(self) -> None:
        """Give robots goals and routes. Here the host waits for the device, once in a step in which it makes no route.

        ActionError if the device found invalid actions.
        """
        if self._live is None:
            self._memory.launch(drivers.give, self._threads, self._work)
        valid, wanted = torch.stack((self._go[0], self._tensors["wanted"].count_nonzero())).tolist()
        if not valid:
            raise ActionError("actions must be finite, and discrete ones in 0..K-1; some are not")
        if self._live is not None:
            rows = self._live.give(self.steps + 1, self._tensors)
            self._fit_routes(self._live.dispatcher.routes.shape[2])
            self._live.upload(rows, self._tensors)
        if wanted:
            self.host.dispatcher.route_table.trim()
            self._go.fill_(drivers.WANTED)
            while self._make_routes():
                self._memory.launch(drivers.give, self._threads, self._work)

    def put(self, pose: ArrayLike, speed: ArrayLike) -> NDArray[np.bool_]:
        """Put robots as `Simulator.put` does, on the host, and observe."""
        host, tensors = self.host, self._tensors
        placed = poses("pose", pose, (self.num_worlds, self.num_agents, 3), host.grid)
        driven = speeds(speed, self.num_worlds, self.config.robots)
        robots = tensors["robots"].cpu().numpy().view(state.ROBOT)[..., 0]
        routes = tensors["routes"].cpu().numpy()
        shared, kinds = host.setup.planned
        free = put_all(robots, routes, placed, driven, (shared, kinds), host.setup.floor)
        tensors["robots"].copy_(tensor_of(robots))
        if self._errs:
            bodies = tensors["actual"].cpu().numpy().view(BODY)[..., 0]
            for body, placed_robots in zip(bodies, robots, strict=True):
                place_bodies(body, placed_robots)
            tensors["actual"].copy_(tensor_of(bodies))
        tensors["waiting"].fill_(1)
        self._observe()
        return free

    @property
    def arrivals(self) -> list[Arrival]:
        """The tasks finished in the last step, copied from the device when asked for."""
        where = torch.nonzero(field_on_device(self._tensors["robots"], "arrived"))
        booked = self._tensors["booked"][where[:, 0], where[:, 1]].tolist()
        return [Arrival(*robot, *lengths) for robot, lengths in zip(where.tolist(), booked, strict=True)]

    def save_state(self) -> dict[str, torch.Tensor]:
        """Return a copy of all that the worlds need to continue to the same bits, on the device."""
        own = {"begun": self._draws.begun, "cut_off": self._cut_off}
        own |= {} if self._live is None else self._live.state()
        state_of_host = {name: tensor_of(array).to(self.device) for name, array in own.items()}
        return {name: tensor.clone() for name, tensor in self._tensors.items()} | state_of_host

    def load_state(self, saved: dict[str, torch.Tensor]) -> None:
        """Continue from the state that a simulator of the same config and number of worlds has saved."""
        keys = self._draws.keys.view(np.int64)
        own = {"begun": self._draws.begun, "cut_off": self._cut_off, "keys": keys}
        for name, array in (own | {"steps": self.steps, "truncated": self.truncated}).items():
            array[...] = saved[name].cpu().numpy()
        width = saved["routes"].shape[2]
        self._fit_routes(width)
        if self._live is not None:
            self._live.load({name: saved[name].cpu().numpy() for name in self._live.state()})
        self._tensors["routes"][:, :, width:] = 0
        for name, tensor in self._tensors.items():
            (tensor[:, :, :width] if name == "routes" else tensor).copy_(saved[name])

    def download(self, worlds: list[int]) -> NDArray[Any]:
        """Return a copy of the robots of some worlds, ROBOT[W, N]."""
        copied: NDArray[Any] = self.robots[torch.as_tensor(worlds, device=self.device)].cpu().numpy()
        return copied.view(state.ROBOT)[..., 0]

    def metrics(self, worlds: list[int]) -> list[dict[str, float]]:
        """Return the numbers of some worlds' episodes so far (Simulator.episode_metrics)."""
        config = self.config
        seconds = (self.steps[worlds] * config.action_repeat * config.time_step).astype(np.float64)
        rows = episode_rows(self.download(worlds), seconds, config)
        return [row | {"cut_off": float(cut_off)} for row, cut_off in zip(rows, self._cut_off[worlds], strict=True)]
