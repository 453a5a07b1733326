"""A device's worlds: the bits of the Simulator, what is refused, and kernels that a GPU computes alike."""

from __future__ import annotations

import importlib.util
import re
from typing import Any

import numpy as np
import pytest
import torch

from warehouse_env import ConfigError, EnvConfig, RewardWeights, SensorSpec, Simulator, TrafficSpec, UncertaintySpec
from warehouse_env.errors import ActionError
from warehouse_env.simulation.device import drivers, memory
from warehouse_env.simulation.device.simulator import DeviceSimulator, check_device
from warehouse_env.simulation.state import OWNER, field_of

ON_CARD = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
DEVICES = ["cpu", pytest.param("cuda", marks=ON_CARD)]
WORLDS, ROBOTS = 5, 12
SHIELD, RULES = TrafficSpec(shield=True), TrafficSpec(shield=True, right_of_way=True)
SETS: dict[str, dict[str, Any]] = {
    "nothing": {},
    "shield": {"traffic": SHIELD},
    "raw": {"action_type": "raw"},
    "continuous": {"action_type": "continuous", "layout": "narrow"},
    "predictions": {"sensor": SensorSpec(predictions=True)},
    "collisions end": {"terminate_on_collision": True},
    "one shot": {"tasks": "one_shot"},
    "errors and losses": {
        "traffic": SHIELD,
        "uncertainty": UncertaintySpec(
            pose_error=0.03, heading_error=0.02, actuation_error=0.1, latency=0.3, loss=0.1, burst=1.0
        ),
    },
    "right of way": {"traffic": RULES, "layout": "narrow"},
}


def config(**changes: Any) -> EnvConfig:
    return EnvConfig(**{"num_agents": ROBOTS, "planner": "astar_turns", "max_steps": 150, **changes})


def commands(sim: Simulator, rng: np.random.Generator) -> Any:
    """Full speed along the routes, with a fifth of random commands, so that robots meet, stray and search."""
    if sim.config.traffic_spec.right_of_way and sim.steps[0] % 2:  # preferences
        return rng.normal(size=(WORLDS, ROBOTS, len(sim.actions.table))).astype(np.float32)
    if sim.config.action_type == "discrete":
        given = np.full((WORLDS, ROBOTS), sim.cruise_action)
        return np.where(rng.random(given.shape) < 0.2, rng.integers(0, sim.action_space.n, given.shape), given)
    return rng.uniform(-1.3, 1.3, (WORLDS, ROBOTS, 2)).astype(np.float32) + np.float32([0.3, 0.0])


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("changes", SETS.values(), ids=SETS)
def test_a_device_has_the_bits_of_the_simulator(changes: dict[str, Any], device: str) -> None:
    here, there = Simulator(config(**changes), WORLDS), DeviceSimulator(config(**changes), WORLDS, device=device)
    assert np.array_equal(here.reset(7), there.reset(7).cpu())
    rng, arrivals = np.random.default_rng(1), 0
    for _ in range(250):
        given = commands(here, rng)
        here.step(given)
        there.step(torch.from_numpy(given).to(there.device))
        arrivals += len(here.arrivals)
        assert here.arrivals == there.arrivals
        assert np.array_equal(here.truncated, there.truncated)
        assert np.array_equal(here.terminated, there.terminated.cpu())
        assert np.array_equal(here.observation, there.observation.cpu())
        assert np.array_equal(here.reward, there.reward.cpu())
        if here.steps[1] == 100:  # one world alone begins anew
            here.reset_worlds([1])
            there.reset_worlds([1])
    there.download(list(range(WORLDS)))
    for name in OWNER:
        assert field_of(here.robots, name).tobytes() == field_of(there.host.robots, name).tobytes(), name
    assert arrivals > 0 or "action_type" in changes


def test_rewards_take_new_weights_on_the_way() -> None:
    here, there = Simulator(config(), WORLDS), DeviceSimulator(config(), WORLDS, device="cpu")
    assert np.array_equal(here.reset(7), there.reset(7))
    given, before = np.full((WORLDS, ROBOTS), here.cruise_action), there.reward.clone()
    for progress in (0.0, 5.0):
        here.reward_weights = there.reward_weights = RewardWeights(progress=progress)
        here.step(given)
        there.step(torch.from_numpy(given))
        assert np.array_equal(here.reward, there.reward)
        assert not torch.equal(before, there.reward)
        before = there.reward.clone()


@pytest.mark.parametrize("device", DEVICES)
def test_a_saved_state_continues_to_the_same_bits(device: str) -> None:
    first, second = (DeviceSimulator(config(traffic=SHIELD), WORLDS, device=device) for _ in range(2))
    rng = np.random.default_rng(1)
    pool = [torch.from_numpy(commands(first.host, rng)).to(first.device) for _ in range(200)]
    first.reset(7)
    second.reset(8)
    for given in pool[:100]:
        first.step(given)
    saved, ends = first.save_state(), []
    for simulator in (first, second):
        simulator.load_state(saved)
        for given in pool[100:]:
            simulator.step(given)
            ended = np.flatnonzero(simulator.truncated).tolist()
            simulator.reset_worlds(ended)
        ends.append(simulator.save_state())
    assert simulator.steps.tolist() == [50] * WORLDS
    assert {name for name in ends[0] if not torch.equal(ends[0][name], ends[1][name])} == set()


def test_threads_share_the_worlds_and_have_scratch_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory.Memory, "threads", lambda self, most: 3)  # five worlds: 1, 2 and 2
    assert [drivers.part_of(thread, 3, WORLDS) for thread in range(3)] == [(0, 1), (1, 3), (3, 5)]
    test_a_device_has_the_bits_of_the_simulator(SETS["shield"], "cpu")


def test_what_a_device_has_not_is_named() -> None:
    with pytest.raises(ConfigError, match="people, live routes"):
        check_device(config(traffic="rules", people=1))


@pytest.mark.parametrize("bad", [torch.zeros(WORLDS, ROBOTS), torch.zeros(WORLDS, 1, dtype=torch.int64)])
def test_actions_of_another_kind_or_shape_are_refused(bad: torch.Tensor) -> None:
    simulator = DeviceSimulator(config(), WORLDS, device="cpu")
    simulator.reset(0)
    with pytest.raises(ActionError, match="whole numbers of shape"):
        simulator.step(bad)


@pytest.mark.parametrize("bad", [-1, 99])
def test_actions_out_of_range_are_refused(bad: int) -> None:
    simulator = DeviceSimulator(config(), WORLDS, device="cpu")
    simulator.reset(0)
    before = simulator.robots.clone()
    with pytest.raises(ActionError, match=r"0\.\.K-1"):
        simulator.step(torch.full((WORLDS, ROBOTS), bad))
    assert torch.equal(simulator.robots, before)


@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is not None, reason="numba-cuda is installed")
def test_without_numba_cuda_a_sentence_says_what_is_missing() -> None:
    with pytest.raises(ConfigError, match="the extra `cuda`"):
        DeviceSimulator(config(), 1, device="cuda")


@pytest.mark.nightly
@pytest.mark.parametrize("driver", ["rank", "lose", "err", "decide", "resolve", "advance", "search", "observe"])
def test_a_kernel_for_a_gpu_rounds_each_operation_as_the_cpu_does(driver: str) -> None:
    """PTX without fused, approximate or flushing arithmetic: `make cuda` compiles it, and needs no GPU."""
    pytest.importorskip("numba_cuda")
    from warehouse_env.simulation.device.shim import compile_ptx

    changes = SETS["errors and losses"] | SETS["predictions"] | {"traffic": RULES}
    simulator = DeviceSimulator(config(**changes), 4, device="compiler")
    simulator._decoder.decode(torch.zeros(4, ROBOTS, 20), simulator._tensors, simulator._batch.worlds)
    assert simulator._decoder._likes is not None
    noise = simulator._noise
    batches: dict[str, Any] = {"rank": simulator._decoder._likes[1], "lose": noise, "err": noise}
    ptx = compile_ptx(getattr(drivers, driver), 4, batches.get(driver, simulator._batch))
    done = set(re.findall(r"\b(?:add|sub|mul|div|fma|mad|sqrt|rcp|rsqrt|sin|cos|ex2|lg2)\.[a-z.]*f(?:32|64)", ptx))
    assert "add.rn.f32" in done or driver in batches
    assert [one for one in done if not re.fullmatch(r"(add|sub|mul|div|sqrt|rcp)\.rn\.f(32|64)", one)] == []
