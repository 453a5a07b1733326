"""A reset starts robots where its options say, in every adapter, or refuses them in one sentence."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

from warehouse_env import EnvConfig, Simulator, aec_env, parallel_env, single_env, tensor_env, vec_env
from warehouse_env.errors import ActionError, ConfigError

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
        ({"num_agents": 0}, "num_agents=0 must be a whole number of at least 1"),
        ({"starts": [STARTS[0]] * 2, "goals": GOALS}, "robot 1 touches"),
        (3, "options=3 must be a dict of starts, goals, num_agents"),
    ],
)
def test_what_cannot_be_is_refused(adapter: str, options: Any, said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        begin(adapter, options)
    assert said in str(refused.value)


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_an_environment_has_no_more_robots_than_it_was_made_for(adapter: str) -> None:
    said = "is more than the 2" if adapter in ("parallel", "aec") else "only parallel_env and aec_env change"
    with pytest.raises(ConfigError, match=said):
        begin(adapter, {"num_agents": 3})


def test_an_episode_of_fewer_robots_is_that_of_an_environment_of_as_many() -> None:
    several, four = parallel_env(CONFIG, num_agents=4), parallel_env(CONFIG, num_agents=4)
    for env in (several, four):
        env.reset(seed=3)
    seen, _ = several.reset(seed=5, options={"num_agents": 2})
    two = parallel_env(CONFIG)
    expected, _ = two.reset(seed=5)
    for step in range(30):
        assert list(seen) == several.agents == ["robot_0", "robot_1"]
        assert all(np.array_equal(seen[name], expected[name]) for name in expected)
        several = copy.deepcopy(several)
        assert several.state().shape == several.state_space.shape
        assert np.array_equal(several.state()[:16], two.state())
        assert not several.state()[16:].any()
        commands = dict.fromkeys(several.agents, step % 3)
        seen, *rest = several.step(commands)
        expected, *same = two.step(commands)
        assert repr(rest) == repr(same)
    with pytest.raises(ActionError, match="robot_2"):
        several.step(dict.fromkeys(several.possible_agents, 0))
    several.reset(seed=3)
    assert several.agents == several.possible_agents
    for count in (3, 1, 4):  # without a seed, too, what follows is fixed by the last one
        seen, expected = (env.reset(options={"num_agents": count})[0] for env in (several, four))
        assert len(seen) == count
        assert all(np.array_equal(seen[name], expected[name]) for name in seen)


def test_turns_of_fewer_robots() -> None:
    env = aec_env(CONFIG, num_agents=4, max_steps=5)
    env.reset(seed=1, options={"num_agents": 3})
    acted = []
    for agent in env.agent_iter():
        over = env.terminations[agent] or env.truncations[agent]
        acted.append(agent)
        env.step(None if over else 0)
    assert acted == ["robot_0", "robot_1", "robot_2"] * 6


def test_several_worlds_need_a_table_each() -> None:
    for starts in (STARTS, np.array(STARTS), 3):
        with pytest.raises(ConfigError, match="lists of a table for each of the 3 worlds"):
            vec_env(3, CONFIG).set_options({"starts": starts, "goals": [GOALS] * 3})
