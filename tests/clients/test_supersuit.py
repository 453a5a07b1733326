"""SuperSuit: the usual way from PettingZoo to stable-baselines3, with the envs in processes of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
import supersuit

from warehouse_env import parallel_env


def rows_of(options: dict[str, Any], worlds: int, cpus: int) -> Any:
    """Worlds with one row for each robot, shared out over `cpus` processes."""
    rows = supersuit.pettingzoo_env_to_vec_env_v1(parallel_env(**options))
    return supersuit.concat_vec_envs_v1(rows, worlds, num_cpus=cpus, base_class="stable_baselines3")


def test_each_world_is_the_env_itself(small: dict[str, Any]) -> None:
    """What comes back from the processes is what the env gives here, to the bit."""
    env = rows_of(small, 2, 2)
    here = [parallel_env(**small) for _ in range(2)]
    observation, _ = env.venv.reset(seed=5)  # SuperSuit's VecEnv for SB3 has no `seed` that works
    seen = [world.reset(seed=5 + k)[0] for k, world in enumerate(here)]
    rng = np.random.default_rng(0)
    for _ in range(20):
        np.testing.assert_array_equal(observation, [row for part in seen for row in part.values()])
        actions = rng.integers(0, env.action_space.n, env.num_envs)
        observation, reward, _, _ = env.step(actions)
        steps = [
            world.step(dict(zip(world.agents, part, strict=True)))
            for world, part in zip(here, actions.reshape(2, 3), strict=True)
        ]
        seen = [step[0] for step in steps]
        np.testing.assert_array_equal(reward, np.float32([value for step in steps for value in step[1].values()]))
    env.close()
