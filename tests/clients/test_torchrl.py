"""TorchRL: its own check of an env, and a rollout; also where robots leave before the others do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from warehouse_env import parallel_env


@pytest.mark.parametrize("tasks", ["lifelong", "one_shot"])
@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_specs_and_rollout(small: dict[str, Any], tasks: str, action_type: str) -> None:
    # Imported here, since it sets how this process starts others, and the tests of other clients have theirs.
    from torchrl.envs.libs.pettingzoo import PettingZooWrapper
    from torchrl.envs.utils import check_env_specs

    one_shot = tasks == "one_shot"
    inner = parallel_env(**small | {"max_steps": 120}, tasks=tasks, action_type=action_type)
    # Those that have left are masked; the episode ends with the last one.
    env = PettingZooWrapper(inner, use_mask=one_shot, done_on_any=not one_shot, categorical_actions=True)
    check_env_specs(env)
    env.set_seed(3)
    cruise = torch.as_tensor(np.stack([inner.simulator.cruise_action] * 3))
    steps = env.rollout(150, lambda given: given.set(("robot", "action"), cruise), break_when_any_done=False)
    robots = steps["robot"]
    assert robots["observation"].shape == (150, 3, inner.simulator.layout.size)
    assert torch.isfinite(steps["next", "robot", "reward"]).all()
    assert steps["next", "done"].any()
    if one_shot:
        assert 0 < robots["mask"].sum() < robots["mask"].numel()  # some left while others drove
