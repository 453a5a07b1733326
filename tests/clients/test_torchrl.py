"""Test both TorchRL adapters: spec checks, rollouts with the Simulator's bits, robots that leave early."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from warehouse_env import EnvConfig, Simulator, parallel_env

# Tests import TorchRL themselves: importing it sets the start method of processes, which other clients' tests need.


@pytest.mark.parametrize("tasks", ["lifelong", "one_shot"])
@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_pettingzoo_wrapper_passes_spec_check_and_rollout(small: dict[str, Any], tasks: str, action_type: str) -> None:
    from torchrl.envs.libs.pettingzoo import PettingZooWrapper
    from torchrl.envs.utils import check_env_specs

    one_shot = tasks == "one_shot"
    inner = parallel_env(**small | {"max_steps": 250}, tasks=tasks, action_type=action_type)
    # The mask hides robots that have left; the episode ends with the last robot.
    env = PettingZooWrapper(inner, use_mask=one_shot, done_on_any=not one_shot, categorical_actions=True)
    check_env_specs(env)
    env.set_seed(3)
    cruise = torch.as_tensor(np.stack([inner.simulator.cruise_action] * 3))
    steps = env.rollout(300, lambda given: given.set(("robot", "action"), cruise), break_when_any_done=False)
    robots = steps["robot"]
    assert robots["observation"].shape == (300, 3, inner.simulator.layout.size)
    assert torch.isfinite(steps["next", "robot", "reward"]).all()
    assert steps["next", "done"].any()
    if one_shot:
        assert 0 < robots["mask"].sum() < robots["mask"].numel()  # some robots left before others


@pytest.mark.parametrize("tasks", ["lifelong", "one_shot"])
@pytest.mark.parametrize("action_type", ["discrete", "continuous", "raw"])
def test_batched_worlds_equal_the_simulator_to_the_bit(small: dict[str, Any], tasks: str, action_type: str) -> None:
    """Cover partial resets: worlds of one-shot tasks end at different times."""
    from torchrl.envs.utils import check_env_specs

    from warehouse_env.torchrl import torchrl_env

    options = small | {"max_steps": 250, "tasks": tasks, "action_type": action_type}
    check_env_specs(torchrl_env(3, **options))
    env, alone = torchrl_env(3, seed=5, **options), Simulator(EnvConfig(**options), 3)
    alone.reset(5)
    action = np.array(np.broadcast_to(alone.cruise_action, (3, 3, *env.full_action_spec["robots", "action"].shape[2:])))
    steps = env.rollout(
        300, lambda td: td.set(("robots", "action"), torch.from_numpy(action)), break_when_any_done=False
    )
    resets = []
    for k in range(300):
        now, following = steps[:, k], steps[:, k]["next"]
        assert_same(now["robots", "observation"], alone.observation)
        assert_same(now["robots", "mask"], ~alone.terminated)
        assert_same(now["state"], np.stack([alone.global_state(world) for world in range(3)]))
        alone.step(action)
        assert_same(following["robots", "observation"], alone.observation)
        assert_same(following["robots", "reward"][..., 0], alone.reward)
        assert_same(following["robots", "terminated"][..., 0], alone.terminated)
        assert_same(following["robots", "done"][..., 0], alone.terminated | alone.truncated[:, None])
        assert_same(following["truncated"][:, 0], alone.truncated)
        ended = alone.truncated | alone.terminated.all(axis=1)
        assert_same(following["done"][:, 0], ended)
        if ended.any():
            alone.reset_worlds(np.flatnonzero(ended).tolist())
            resets.append(int(ended.sum()))
    assert resets
    assert min(resets) < 3 or tasks == "lifelong" or action_type == "raw"  # some worlds reset alone


def assert_same(tensor: torch.Tensor, array: Any) -> None:
    np.testing.assert_array_equal(tensor.numpy(), array)


def test_device_worlds_equal_host_worlds_under_one_seed(small: dict[str, Any]) -> None:
    """Compare device worlds on the CPU with the Simulator, to the bit."""
    from torchrl.envs.utils import check_env_specs

    from warehouse_env.simulation.device.simulator import DeviceSimulator
    from warehouse_env.torchrl import WarehouseEnv, torchrl_env

    host = torchrl_env(2, seed=3, **small)
    device = WarehouseEnv(DeviceSimulator(EnvConfig(**small), 2, device="cpu"))
    check_env_specs(device)
    device.set_seed(3)
    actions = torch.randint(0, 20, (60, 2, 3), generator=torch.Generator().manual_seed(0))

    def rollout(env: WarehouseEnv) -> Any:
        todo = iter(actions)
        return env.rollout(60, lambda td: td.set(("robots", "action"), next(todo)), break_when_any_done=False)

    first, second = rollout(host), rollout(device)
    assert (first == second).all()
    assert not (first == rollout(host)).all()  # the generators have advanced
    host.set_seed(3)
    assert (first == rollout(host)).all()
