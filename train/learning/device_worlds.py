"""The worlds of a training on a device, where the rows of TrainingWorlds are tensors.

Nothing waits for the device but the simulators themselves. They step side by side, each in a thread and a stream of its
own, since the small kernels of one leave most of a GPU idle.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from train.learning import checkpoint
from train.learning.worlds import TrainingWorlds, jammed_worlds, price_late_braking, shape_reward, spread_ends
from warehouse_env.config import EnvConfig
from warehouse_env.routes.book import RouteBook
from warehouse_env.simulation.device.memory import field_on_device
from warehouse_env.simulation.device.simulator import DeviceSimulator
from warehouse_env.simulation.given import Seeds
from warehouse_env.simulation.state import OWNER
from warehouse_env.simulation.tasks.assignment import Assignment

ROUND = 20  # env steps between those after which worlds end, since a reset takes as long as a step


class TrainingDevice(DeviceSimulator):
    """TrainingSimulator's twin on a device; its worlds end only every ROUND steps, and a jammed one a step later.

    fields: the robots' fields on the device, by record and name. stuck (a tensor), ends: see TrainingSimulator.
    """

    def __init__(
        self, config: EnvConfig, num_worlds: int, jam_seconds: float, shared: float, device: str,
        routes: RouteBook | None = None, late_braking: float = 0.0,
    ) -> None:  # fmt: skip
        """Make the worlds (see TrainingSimulator); device: by torch's name of it."""
        super().__init__(config, num_worlds, device=device, routes=routes)
        self._jam_seconds, self._shared, self._late = jam_seconds, shared, late_braking
        self.fields: dict[str, dict[str, Tensor]] = {owner: {} for owner in OWNER.values()}
        for name, owner in OWNER.items():
            erring = self._errs and owner == "motion"  # `robots` would be a copy, which the next step leaves behind
            self.fields[owner][name] = field_on_device(self._tensors["actual" if erring else "robots"], name)
        self.stuck, self.ends = torch.zeros(()), list[bool]()
        self._jammed = torch.zeros(num_worlds, dtype=torch.bool, pin_memory=self.device.type == "cuda")

    def reset(self, seed: Seeds = None, assignments: Sequence[Assignment] | None = None) -> Tensor:
        """Start all worlds, and spread the ends of their first episodes evenly."""
        observation = super().reset(seed, assignments)
        spread_ends(self.steps, self.config.max_steps)
        self.steps -= self.steps % ROUND
        self._tensors["steps"].copy_(torch.from_numpy(self.steps))
        return observation

    def step(self, actions: Tensor) -> Tensor:
        """Step all worlds; `reward` is shaped, and `truncated` also tells the worlds that had jammed before."""
        self._jammed.copy_(jammed_worlds(self.fields, self._jam_seconds), non_blocking=True)
        stood = self.fields["motion"]["speed"] == 0
        observation = super().step(actions)  # waits for the device, so what has jammed is known now
        shape_reward(self.reward, self.reward_terms, self.fields, stood, self._shared)
        if self._late:
            price_late_braking(self.reward, observation, self.fields, self.config, self._late)
        self.stuck = (self.fields["clocks"]["stalled_time"] > self.config.stuck_after).sum()
        jammed = self._jammed.numpy() & (self.steps % ROUND == 0)
        np.logical_or(self.truncated, jammed, out=self.truncated)
        self.ends = jammed[self.truncated].tolist()
        return observation

    def lengths(self) -> Tensor:
        """Return the [m] driven and planned, float64[2], of the tasks finished in the last step."""
        return (self.fields["events"]["arrived"].unsqueeze(-1) * self._tensors["booked"]).sum((0, 1))


class DeviceWorlds(TrainingWorlds):
    """The worlds of TrainingDevices. A world's generators go on from episode to episode."""

    replays = False

    def __init__(self, make: Callable[..., Any], mixes: Sequence[tuple[EnvConfig, int]], seed: list[int], device: str):
        """Make and reset all worlds; device: of all, by torch's name of it (see TrainingWorlds)."""
        self._device, self._streams = torch.device(device), dict[int, torch.cuda.Stream]()
        self._pool = ThreadPoolExecutor(len(mixes) if self._device.type == "cuda" else 1)
        super().__init__(partial(make, device=device), mixes, seed)

    def _simulator(self, number: int) -> Any:
        with self._stream(number):
            return super()._simulator(number)

    @contextmanager
    def _stream(self, number: int) -> Iterator[None]:
        """Work with a simulator: after what was asked of the device before, and before what is asked of it then."""
        if self._device.type != "cuda":
            yield
            return
        now = torch.cuda.current_stream(self._device)
        own = self._streams.setdefault(number, torch.cuda.Stream(self._device))  # type: ignore[no-untyped-call]
        own.wait_stream(now)
        with torch.cuda.stream(own):
            yield
        now.wait_stream(own)

    def _step_simulators(self, actions: Tensor) -> None:
        def step(number: int) -> None:
            simulator, block = self.simulators[number], self._blocks[number]
            with self._stream(number):
                simulator.step(actions[block].reshape(simulator.num_worlds, simulator.num_agents, *actions.shape[1:]))

        list(self._pool.map(step, range(len(self.simulators))))

    def _restart(self, due: Sequence[tuple[int, NDArray[np.int64]]]) -> None:
        def restart(one: tuple[int, NDArray[np.int64]]) -> None:
            number, worlds = one
            with self._stream(number):
                self.simulators[number].reset_worlds(worlds.tolist())

        list(self._pool.map(restart, due))

    def history(self) -> dict[str, NDArray[Any]]:
        """Return the state of all worlds, for `replay`."""
        return {
            f"{number}.{name}": tensor.cpu().numpy()
            for number, simulator in enumerate(self.simulators)
            for name, tensor in simulator.save_state().items()
        }

    def replay(self, history: dict[str, NDArray[Any]]) -> None:
        """Bring all worlds to where they stood when `history` was taken."""
        for number, simulator in enumerate(self.simulators):
            state = checkpoint.part_of(history, f"{number}.")
            simulator.load_state({name: torch.from_numpy(array) for name, array in state.items()})
        self._observe()
