"""A Gymnasium vector environment of torch tensors: worlds on a GPU (or on the CPU), one row for each robot."""

from collections.abc import Sequence
from typing import Any, Unpack

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.envs.infos import known
from warehouse_env.envs.options import WorldOptions, build, reset
from warehouse_env.errors import ConfigError
from warehouse_env.simulation.device.memory import field_on_device
from warehouse_env.simulation.device.recorder import DeviceRecorder
from warehouse_env.simulation.device.simulator import DeviceSimulator
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import VIEWED, view_scales

Step = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, dict[str, Any]]


class GlobalView:
    """The state of all worlds for centralised critics, computed where the worlds are."""

    def __init__(self, simulator: Simulator | DeviceSimulator) -> None:
        """Find the state's entries in the records of the robots."""
        self._simulator = simulator
        host = simulator if isinstance(simulator, Simulator) else simulator.host
        self.device = torch.device("cpu") if isinstance(simulator, Simulator) else simulator.device
        side = max(host.grid.shape) * host.grid.cell_size
        self._scales = torch.from_numpy(view_scales(side, simulator.config)).to(self.device)

    def __call__(self) -> torch.Tensor:
        """Return float32[worlds, N * 8], a row with the bits of `Simulator.global_state` for each world."""
        robots = self._simulator.robots
        if not isinstance(robots, torch.Tensor):
            robots = torch.from_numpy(robots.view(np.uint8).reshape(*robots.shape, -1))
        viewed = torch.stack([field_on_device(robots, name) for name in VIEWED], dim=-1)
        return (viewed / self._scales).flatten(1)


class WarehouseTensorEnv(VectorEnv[torch.Tensor, torch.Tensor, torch.Tensor]):
    """Many worlds in parallel, rows = worlds x robots, tensors in and out.

    A world resets itself when it is truncated or when all its robots have terminated; until then these stay terminated.

    Observations and rewards are the simulator's own tensors, overwritten by the next step: copy what you keep. In a
    step that ends worlds, infos hold "final_obs" float32[rows, D], "_final_obs" bool[rows] (which rows of it are the
    last of an episode) and "world_metrics", a dict of each ended world's metrics.
    """

    def __init__(self, simulator: DeviceSimulator) -> None:
        """Wrap a simulator; reset before the first step."""
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}
        self.simulator, self.device = simulator, simulator.device
        self.num_envs = simulator.num_worlds * simulator.num_agents
        self.single_observation_space = simulator.host.observation_space
        self.single_action_space = simulator.host.action_space
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, self.num_envs)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, self.num_envs)
        self._state = GlobalView(simulator)
        self._recorder: DeviceRecorder | None = None
        self._never = torch.zeros(self.num_envs, dtype=torch.bool, device=self.device)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[torch.Tensor, dict[str, Any]]:
        """Start all worlds anew, world b from the draws of (seed, b); return observations float32[rows, D].

        options: "starts" and "goals", a table for each world as `WarehouseParallelEnv.reset` takes them.
        """
        if isinstance(seed, list):
            raise ConfigError("reset takes one seed for all worlds")
        self._recorder = None
        return self._rows(reset(self.simulator, seed, options)), {}

    def step(self, actions: torch.Tensor) -> Step:
        """Advance all worlds; actions: int[rows], or float[rows, 2] in [-1, 1], on the device.

        Returns observations [rows, D], rewards, terminations and truncations [rows], and infos.
        """
        simulator = self.simulator
        actions = actions.view(simulator.num_worlds, simulator.num_agents, *actions.shape[1:])
        observation = self._rows(simulator.step(actions))
        if self._recorder is not None:
            self._recorder.keep(actions)
        reward, terminated, late = self._rows(simulator.reward), self._rows(simulator.terminated), simulator.truncated
        over = late | simulator.all_terminated()
        if not over.any():
            return observation, reward, terminated, self._never, {}
        ended, truncated = np.flatnonzero(over).tolist(), self._of_worlds(late)
        metrics = {world: known(row) for world, row in zip(ended, simulator.metrics(ended), strict=True)}
        infos = {"final_obs": observation.clone(), "_final_obs": self._of_worlds(over), "world_metrics": metrics}
        reward, terminated = reward.clone(), terminated.clone()  # of the step, not of the reset
        simulator.reset_worlds(ended)
        if self._recorder is not None and over[self._recorder.worlds].any():
            self._recorder = None
        return observation, reward, terminated, truncated, infos

    def _of_worlds(self, flags: NDArray[np.bool_]) -> torch.Tensor:
        """Return the rows' flags of flags bool[worlds]."""
        return torch.from_numpy(np.repeat(flags, self.simulator.num_agents)).to(self.device)

    def _rows(self, tensor: torch.Tensor) -> torch.Tensor:
        return tensor.view(self.num_envs, *tensor.shape[2:])

    def record(self, worlds: Sequence[int], seed: int = 0) -> DeviceRecorder:
        """Start some worlds anew, the k-th with the seed `seed + k`, and keep their episodes until one ends.

        `.episode.save(path)` of what is returned writes a file for `warehouse replay` and `audit` at any time. A reset
        or another recording ends this one. ConfigError for worlds that do not exist, and for a bad seed.
        """
        self._recorder = DeviceRecorder(self.simulator, worlds, seed)
        return self._recorder

    def state(self, per_row: bool = False) -> torch.Tensor:
        """Return float32[worlds, N * 8] for centralised critics (Simulator.global_state); per_row: [rows, N * 8]."""
        state = self._state()
        return state.repeat_interleave(self.simulator.num_agents, 0) if per_row else state


def tensor_env(
    num_worlds: int = 1, config: EnvConfig | None = None, *, device: str = "cuda", **options: Unpack[WorldOptions]
) -> WarehouseTensorEnv:
    """Return an environment of torch tensors, e.g. `tensor_env(4096, num_agents=16, device="cuda")`.

    device: as torch names it; "cpu" has the same bits and needs no GPU. ConfigError says what cannot be used: a device
    simulates neither people nor orders or live routes yet.
    """
    return WarehouseTensorEnv(build(DeviceSimulator, config, options, num_worlds, device=device))
