"""TorchRL: an EnvBase over a batch of worlds, on the CPU or on a GPU. Needs the package torchrl."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Unpack

import gymnasium
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Bounded, Categorical, Composite, TensorSpec, Unbounded
from torchrl.envs import EnvBase

from warehouse_env.config import EnvConfig
from warehouse_env.envs.options import WorldOptions, build, reset
from warehouse_env.envs.tensors import GlobalView
from warehouse_env.errors import ConfigError
from warehouse_env.simulation.device.simulator import DeviceSimulator
from warehouse_env.simulation.given import whole_seed
from warehouse_env.simulation.simulator import Simulator

GROUP = "robots"  # the key of all robots' entries


class WarehouseEnv(EnvBase):  # type: ignore[misc]
    """Many worlds in parallel: batch size [worlds], all robots of a world under the key "robots".

    "robots" holds observation float32[worlds, N, D], action, reward float32[worlds, N, 1], mask bool[worlds, N] and the
    flags done, terminated and truncated bool[worlds, N, 1]. "state" float32[worlds, N * 8] is for centralised critics
    (Simulator.global_state). A world is done when it is truncated or when all its robots have terminated. Robots that
    terminate earlier (one-shot tasks) park: their mask is False, their reward 0, and they stay terminated.
    """

    def __init__(self, simulator: Simulator | DeviceSimulator, *, seed: int | None = None) -> None:
        """Wrap a simulator of any number of worlds; seed: of the first reset."""
        host = simulator if isinstance(simulator, Simulator) else simulator.host
        self._global_view = GlobalView(simulator)
        super().__init__(device=self._global_view.device, batch_size=[simulator.num_worlds])
        self.simulator, self.config = simulator, simulator.config
        self.group_map = {GROUP: [f"robot_{k}" for k in range(simulator.num_agents)]}
        self._seed = seed
        self._make_specs(host.observation_space.shape[0], host.action_space)

    def _make_specs(self, size: int, actions: gymnasium.Space[Any]) -> None:
        worlds, robots = self.batch_size, (*self.batch_size, self.simulator.num_agents)
        observed = {"observation": self._numbers(*robots, size), "mask": self._flags(*robots)}
        self.observation_spec = Composite(
            {GROUP: self._group(observed), "state": self._numbers(*worlds, 8 * robots[-1])},
            shape=worlds, device=self.device,
        )  # fmt: skip
        action: TensorSpec
        if isinstance(actions, gymnasium.spaces.Discrete):
            action = Categorical(int(actions.n), shape=robots, dtype=torch.int64, device=self.device)
        else:
            action = Bounded(-1.0, 1.0, (*robots, 2), dtype=torch.float32, device=self.device)
        self.action_spec = Composite({GROUP: self._group({"action": action})}, shape=worlds, device=self.device)
        reward = self._group({"reward": self._numbers(*robots, 1)})
        self.reward_spec = Composite({GROUP: reward}, shape=worlds, device=self.device)
        names = ("done", "terminated", "truncated")
        each = self._group({name: self._flags(*robots, 1) for name in names})
        ends = {name: self._flags(*worlds, 1) for name in names}
        self.done_spec = Composite({GROUP: each, **ends}, shape=worlds, device=self.device)

    def _group(self, entries: dict[str, TensorSpec]) -> Composite:
        return Composite(entries, shape=(*self.batch_size, self.simulator.num_agents), device=self.device)

    def _numbers(self, *shape: int) -> TensorSpec:
        return Unbounded(shape, dtype=torch.float32, device=self.device)

    def _flags(self, *shape: int) -> TensorSpec:
        return Categorical(2, shape=shape, dtype=torch.bool, device=self.device)

    def _set_seed(self, seed: int | None) -> None:
        """Use a seed at the next reset of all worlds; world b draws from (seed, b)."""
        self._seed = None if seed is None else whole_seed(seed)

    def _reset(self, tensordict: TensorDictBase | None = None, *, options: Any = None) -> TensorDictBase:
        """Start all worlds anew, or those that "_reset" bool[worlds, 1] names; generators go on without a seed.

        options: starts and goals of all worlds, as `tensor_env` takes them.
        """
        chosen = None if tensordict is None else tensordict.get("_reset", None)
        if chosen is None:
            reset(self.simulator, self._seed, options)
            self._seed = None
        elif options:
            raise ConfigError('options are of a reset of all worlds; reset without "_reset"')
        else:
            self.simulator.reset_worlds(chosen.view(-1).nonzero().view(-1).tolist())
        return self._seen({})

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        actions = tensordict.get((GROUP, "action"))
        self.simulator.step(actions.numpy() if isinstance(self.simulator, Simulator) else actions)
        return self._seen({"reward": self._copied(self.simulator.reward).unsqueeze(-1)})

    def _seen(self, entries: dict[str, torch.Tensor]) -> TensorDictBase:
        """Return what a step or reset shows, in tensors that no later step overwrites."""
        simulator = self.simulator
        count, worlds = simulator.num_agents, self.batch_size
        late = self._copied(simulator.truncated).unsqueeze(-1)
        parked = self._copied(simulator.terminated)
        truncated = late.expand(*worlds, count)
        all_parked = parked.all(-1, keepdim=True)
        entries |= {
            "observation": self._copied(simulator.observation), "mask": ~parked,
            "done": (parked | truncated).unsqueeze(-1), "terminated": parked.unsqueeze(-1),
            "truncated": truncated.unsqueeze(-1).clone(),
        }  # fmt: skip
        robots = TensorDict(entries, (*worlds, count), device=self.device)
        ends = {"done": late | all_parked, "terminated": all_parked, "truncated": late}
        return TensorDict({GROUP: robots, "state": self._global_view(), **ends}, worlds, device=self.device)

    def _copied(self, values: Any) -> torch.Tensor:
        return torch.as_tensor(values).to(self.device, copy=True)


def torchrl_env(
    num_worlds: int = 1, config: EnvConfig | None = None, *, device: str = "cpu", seed: int | None = None,
    **options: Unpack[WorldOptions]
) -> WarehouseEnv:  # fmt: skip
    """Return a TorchRL environment, e.g. `torchrl_env(64, num_agents=16, layout="open")`.

    device: "cpu" simulates everything; a GPU, as "cuda", what `tensor_env` does. seed: of the first reset.
    """
    on_cpu = str(device).partition(":")[0] == "cpu"
    kind: Callable[..., Simulator | DeviceSimulator] = Simulator if on_cpu else DeviceSimulator
    parts: dict[str, Any] = {} if on_cpu else {"device": device}
    simulator = build(kind, config, options, num_worlds, **parts)
    return WarehouseEnv(simulator, seed=seed)
