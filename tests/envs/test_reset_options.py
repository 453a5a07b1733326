"""A reset starts robots where its options say, in every adapter, or refuses them in one sentence."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from warehouse_env import EnvConfig, Simulator, aec_env, parallel_env, single_env, tensor_env, vec_env
from warehouse_env.errors import ConfigError

CONFIG = EnvConfig(layout="open", num_agents=2, planner="astar")
STARTS = [(2.5, 4.5, 0.3), (8.5, 2.5, math.pi / 2)]
GOALS = [(9, 2), (3, 9)]
ONE = {"parallel": parallel_env, "aec": aec_env, "single": single_env}
ADAPTERS = [*ONE, "vector", "tensors", "torchrl"]


def begin(adapter: str, options: Any) -> tuple[Simulator, Any]:
    """Reset an env by seed 3 and options; returns its simulator, and another of a second world, if there is one."""
    if adapter in ONE:
        env: Any = ONE[adapter](CONFIG)
        env.reset(seed=3, options=options)
        return env.unwrapped.simulator, None
    if isinstance(options, dict):  # of two worlds, the second with the tables turned round
        options = {name: [of, of[::-1]] if isinstance(of, list) else of for name, of in options.items()}
    if adapter == "vector":
        env = vec_env(configs=[CONFIG, CONFIG])
        env.seed(3)
        env.set_options(options)
        env.reset()
        return env.blocks[0].simulator, env
    if adapter == "tensors":
        env = tensor_env(2, CONFIG, device="cpu")
        env.reset(seed=3, options=options)
        simulator = Simulator(CONFIG, 2)
        simulator.robots[:] = env.simulator.download([0, 1])
        return simulator, None
    pytest.importorskip("torchrl")
    from warehouse_env.torchrl import torchrl_env

    env = torchrl_env(2, CONFIG, seed=3)
    env.reset(options=options)
    return env.simulator, None


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_robots_start_and_go_as_options_say(adapter: str) -> None:
    simulator, vector = begin(adapter, {"starts": STARTS, "goals": GOALS, "num_agents": 2})
    np.testing.assert_allclose(simulator.state.pose[0], STARTS, atol=1e-6)
    assert simulator.state.goal[0].tolist() == [list(goal) for goal in GOALS]
    if vector is not None:
        second = vector.blocks[1].simulator.state.pose[0]
        np.testing.assert_allclose(second, STARTS[::-1], atol=1e-6)
        vector.reset()  # options are of one reset
        assert not np.allclose(second, STARTS[::-1], atol=0.1)
    drawn = Simulator(CONFIG)
    drawn.reset(3)
    for nothing in (None, {"num_agents": 2, "starts": None}):
        np.testing.assert_array_equal(begin(adapter, nothing)[0].state.pose[0], drawn.state.pose[0])


@pytest.mark.parametrize("adapter", ADAPTERS)
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"start": STARTS}, "unknown option of a reset 'start'; did you mean starts?"),
        ({"goals": GOALS}, "starts and goals of a reset go together"),
        ({"num_agents": 3}, "cannot change the number of robots to 3; make an environment of as many"),
        ({"starts": [STARTS[0]] * 2, "goals": GOALS}, "robot 1 touches"),
        (3, "options=3 must be a dict of starts, goals, num_agents"),
    ],
)
def test_what_cannot_be_is_refused(adapter: str, options: Any, said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        begin(adapter, options)
    assert said in str(refused.value)


def test_several_worlds_need_a_table_each() -> None:
    for starts in (STARTS, np.array(STARTS), 3):
        with pytest.raises(ConfigError, match="lists of a table for each of the 3 worlds"):
            vec_env(3, CONFIG).set_options({"starts": starts, "goals": [GOALS] * 3})
