"""DeviceSimulator: B worlds whose step runs on a GPU, with the bits of the Simulator.

Motion, contact, manoeuvres, observations and rewards are computed on the device. The host keeps a Simulator of the same
worlds. It places robots at a reset, and gives those that arrive their next goal and route: only their records travel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.errors import ActionError, ConfigError
from warehouse_env.simulation import state
from warehouse_env.simulation.device import drivers
from warehouse_env.simulation.device.actions import TensorDecoder
from warehouse_env.simulation.device.memory import mapped, memory_of, tensor_of
from warehouse_env.simulation.driver.scratch import make_search_scratch
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.tasks.tasks import Arrival
from warehouse_env.simulation.traffic import off_route
from warehouse_env.simulation.traffic.path_ahead import POSES
from warehouse_env.simulation.worlds import Worlds, make_scratch

SEARCHES = 4096  # threads that search manoeuvres at once: each has 1 MB of scratch

# What a config may not have on a device, and how an error names it
_ABSENT: tuple[tuple[str, Callable[[EnvConfig], bool]], ...] = (
    ("mixed fleets", lambda config: bool(config.fleet)),
    ("people", lambda config: config.people > 0),
    ("orders, services and batteries", lambda config: config.works),
    ("live routes", lambda config: config.traffic_spec.routes is not False),
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
        self.host = Simulator(config, num_worlds, **parts)
        self.config, self.num_worlds, self.num_agents = config, num_worlds, config.num_agents
        self.device, self.arrivals = self._memory.device, list[Arrival]()
        self._tensors: dict[str, torch.Tensor] = {}
        self._allocate()

    @property
    def steps(self) -> NDArray[np.int64]:
        """Env steps since each world's reset."""
        return self.host.steps

    @property
    def truncated(self) -> NDArray[np.bool_]:
        """Whether each world has reached max_steps."""
        return self.host.truncated

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
        """Return the arrays of the host that the device has, too, by name."""
        host = self.host
        drawn = {"keys": host.draws.keys, "left": host.messages.losses.left, "drift": host.deviation.walk.drift}
        return host.worlds._asdict() | drawn

    def _allocate(self) -> None:
        host, memory = self.host, self._memory
        views = dict[str, Any]()
        for name, array in self._arrays().items():
            views[name] = None
            if array is not None:
                self._tensors[name], views[name] = memory.allocate(array.shape, array.dtype)
        self._decides = self.config.traffic_spec.right_of_way
        scratch = make_scratch(host.setup, self.num_agents, self._decides)
        searches = make_search_scratch(self.num_agents, poses=POSES if self._decides else 1)
        self._calls, calls = memory.allocate((self.num_worlds, self.num_agents), np.dtype(np.bool_))
        self._weights, weights = memory.allocate(host.setup.equipment.weights.shape, host.setup.equipment.weights.dtype)
        self.reward_weights = host.reward_weights
        setup = mapped(host.setup, memory.constant)
        setup = setup._replace(equipment=setup.equipment._replace(weights=weights))
        self._threads, self._searches = memory.threads(self.num_worlds), memory.threads(min(self.num_worlds, SEARCHES))
        keys, left, drift = (views.pop(name) for name in ("keys", "left", "drift"))
        worlds, self._errs, self._loses = Worlds(**views), host.setup.features.erring is not None, host.messages.loses
        walk = host.deviation.walk._replace(drift=drift, bounds=memory.constant(host.deviation.walk.bounds))
        losses = host.messages.losses._replace(left=left)
        self._noise = drivers.Noise(keys, worlds.steps, losses, worlds.robots, walk, worlds.errors)
        self._batch = drivers.Batch(
            worlds, setup, mapped(scratch, lambda array: memory.scratch(self._threads, array)),
            mapped(host.search_setup, memory.constant),
            mapped(searches, lambda array: memory.scratch(self._searches, array)),
            host.dispatcher.far, calls,
        )  # fmt: skip
        self.observation, self.reward = self._tensors["observation"], self._tensors["reward"]
        self.reward_terms = self._tensors["terms"]
        self._decoder = TensorDecoder(self.config, host.actions, memory)

    def reset(self, seed: int | Sequence[int] | None = None) -> torch.Tensor:
        """Start all worlds anew, as `Simulator.reset` does, and return the observation."""
        self.host.reset(seed)
        self._upload(range(self.num_worlds))
        return self.observation

    def reset_to(self, assignments: Sequence[Assignment], seed: int | Sequence[int] | None = None) -> torch.Tensor:
        """Start all worlds anew, as `Simulator.reset_to` does, and return the observation."""
        self.host.reset_to(assignments, seed)
        self._upload(range(self.num_worlds))
        return self.observation

    def reset_worlds(self, worlds: list[int], seeds: Sequence[int] | None = None) -> None:
        """Start some worlds anew, with a seed each as `Simulator.reset_world` takes it, or with their next episodes."""
        if seeds is None:
            self.host.reset_worlds(worlds)
        else:
            for world, seed in zip(worlds, seeds, strict=True):
                self.host.reset_world(world, seed)
        self._upload(worlds)

    def _upload(self, worlds: range | list[int]) -> None:
        """Copy some worlds to the device, observations included."""
        self._fit_routes()
        rows = list(worlds)
        on_device = torch.as_tensor(rows, dtype=torch.int64, device=self.device)
        for name, array in self._arrays().items():
            if array is not None and array.size:
                axis = 1 if name == "commands" else 0
                part = tensor_of(np.take(array, rows, axis=axis)).to(self.device)
                self._tensors[name].index_copy_(axis, on_device, part)

    def step(self, actions: torch.Tensor) -> torch.Tensor:
        """Advance all worlds by one env step and return the observation.

        actions: as `Simulator.step` takes them, on the device. ActionError as there.
        """
        if not bool(self._decoder.decode(actions, self._tensors, self._batch.worlds)):  # before anything moves
            raise ActionError("actions must be finite, and discrete ones in 0..K-1; some are not")
        if self._loses:
            self._memory.launch(drivers.lose, self._threads, self._noise)
        if self._errs:
            self._memory.launch(drivers.err, self._threads, self._noise)
        if self._decides:
            self._launch(drivers.decide, self._threads)
            self._launch(drivers.resolve, self._searches)
        self._launch(drivers.advance, self._threads)
        self._launch(drivers.search, self._searches)
        calls = torch.nonzero(self._calls.view(-1)).view(-1)
        self.host.steps += 1
        self.host.truncated[:] = self.host.steps >= self.config.max_steps
        self.arrivals = self._answer(calls) if len(calls) else []
        self._launch(drivers.observe, self._threads)
        return self.observation

    def _launch(self, driver: Callable[..., None], threads: int) -> None:
        self._memory.launch(driver, threads, self._batch)

    def _answer(self, calls: torch.Tensor) -> list[Arrival]:
        """Give the robots that arrived, or are off their routes, what the Simulator would give them."""
        host, count = self.host, self.num_agents
        robots = self._tensors["robots"].view(-1, state.ROBOT.itemsize)
        worlds, numbers = np.divmod(calls.cpu().numpy(), count)
        records = robots[calls].cpu().numpy().view(state.ROBOT)[:, 0]
        planned = host.worlds.robots
        planned[worlds, numbers] = records
        who = list(zip(worlds.tolist(), numbers.tolist(), strict=True))
        arrived = [one for one, record in zip(who, records, strict=True) if record["events"]["arrived"]]
        arrivals = host.dispatcher.arrive(host.steps, arrived)
        host.dispatcher.return_to_route(host.steps, self._off_route(worlds, numbers))
        self._fit_routes()
        robots[calls] = tensor_of(planned[worlds, numbers]).to(self.device)
        routes = self._tensors["routes"].view(-1, *self._tensors["routes"].shape[2:])
        routes[calls] = tensor_of(host.routes[worlds, numbers]).to(self.device)
        return arrivals

    def _off_route(self, worlds: NDArray[np.int64], numbers: NDArray[np.int64]) -> list[tuple[int, int]]:
        """Return which of some robots, as the host has them, are off their routes."""
        off = np.zeros((1, len(worlds)), np.bool_)
        robots, routes = self.host.worlds.robots[worlds, numbers][None], self.host.routes[worlds, numbers][None]
        off_route.find_off_route(robots, routes, self.host.dispatcher.far, off)
        return [(int(worlds[k]), int(numbers[k])) for k in np.flatnonzero(off)]

    def _fit_routes(self) -> None:
        """Take a longer array of routes on the device once the host has one."""
        held, wanted = self._tensors["routes"], self.host.routes.shape
        if held.shape[2] != wanted[2]:
            tensor, view = self._memory.allocate(wanted, self.host.routes.dtype)
            tensor[:, :, : held.shape[2]] = held
            self._tensors["routes"] = tensor
            self._batch = self._batch._replace(worlds=self._batch.worlds._replace(routes=view))

    def save_state(self) -> dict[str, torch.Tensor]:
        """Return a copy of all that the worlds need to continue to the same bits, on the device."""
        goals = {name: tensor_of(array).to(self.device) for name, array in self._goals().items()}
        return {name: tensor.clone() for name, tensor in self._tensors.items()} | goals

    def load_state(self, saved: dict[str, torch.Tensor]) -> None:
        """Continue from the state that a simulator of the same config and number of worlds has saved."""
        for name, array in (self._goals() | {"steps": self.host.steps, "truncated": self.host.truncated}).items():
            array[...] = saved[name].cpu().numpy()
        routes = saved["routes"]
        if routes.shape[2] > self.host.routes.shape[2]:
            self.host.dispatcher.routes = np.zeros(routes.shape, np.float32)
        self._fit_routes()
        self.host.routes[:, :, : routes.shape[2]] = routes.cpu().numpy()
        for name, tensor in self._tensors.items():
            (tensor[:, :, : routes.shape[2]] if name == "routes" else tensor).copy_(saved[name])

    def _goals(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of the host by which goals are drawn, by name."""
        draws = self.host.draws
        return self.host.dispatcher.goals._asdict() | {"keys": draws.keys.view(np.int64), "begun": draws.begun}

    def download(self, worlds: list[int]) -> NDArray[Any]:
        """Copy the robots of some worlds to the host and return them, ROBOT[W, N]."""
        rows = self.robots[torch.as_tensor(worlds, device=self.device)]
        self.host.robots[worlds] = rows.cpu().numpy().view(state.ROBOT)[..., 0]
        return self.host.robots[worlds]

    def metrics(self, worlds: list[int]) -> list[dict[str, float]]:
        """Return the numbers of some worlds' episodes so far (Simulator.episode_metrics)."""
        self.download(worlds)
        return [self.host.episode_metrics(world) for world in worlds]
