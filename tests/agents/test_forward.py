"""Test that the forward pass equals the network and that a row's bits do not depend on its batch."""

from __future__ import annotations

import hashlib
import itertools
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from agents import POLICIES, LearnedPolicy, make_policy, policy_config
from agents.forward import Layer, forward
from agents.networks import ACTIVATIONS
from agents.weights_folder import Activation
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.simulator import Simulator

ROOT = Path(__file__).parents[2]
SIZES = (9, 7, 8, 3)  # input counts that leave a remainder of 1, 3 and 0 after division by four
LEARNED = [name for name, entry in POLICIES.items() if entry.weights is not None]


def layers(sizes: Sequence[int] = SIZES) -> list[Layer]:
    rng = np.random.default_rng(2)
    return [
        (rng.normal(size=(inputs, outputs)).astype(np.float32), rng.normal(size=outputs).astype(np.float32))
        for inputs, outputs in itertools.pairwise(sizes)
    ]


def rows(count: int, size: int = SIZES[0]) -> NDArray[np.float32]:
    return np.random.default_rng(3).normal(size=(count, size)).astype(np.float32)


def float64_outputs(network: Sequence[Layer], observation: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the outputs of the same network in float64."""
    x = observation.astype(np.float64)
    for weight, bias in network[:-1]:
        x = np.tanh(x @ weight.astype(np.float64) + bias)
    return np.asarray(x @ network[-1][0].astype(np.float64) + network[-1][1])


def rollout(name: str, steps: int = 25) -> tuple[LearnedPolicy, NDArray[np.float32]]:
    """Return a policy and the observations [M, D] of its rollout with 24 robots."""
    config = policy_config(name, EnvConfig(num_agents=24, planner="astar"))
    simulator, policy, rng = Simulator(config), make_policy(name, config), np.random.default_rng(0)
    assert isinstance(policy, LearnedPolicy)
    simulator.reset(5)
    seen = [simulator.step(policy.act(simulator.observation, rng))[0].copy() for _ in range(steps)]
    return policy, np.concatenate(seen)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_forward_equals_the_float64_network(count: int) -> None:
    assert forward(layers(), rows(count)) == pytest.approx(float64_outputs(layers(), rows(count)), abs=2e-6)


@pytest.mark.parametrize("name", LEARNED)
def test_shipped_policies_match_float64_outputs(name: str) -> None:
    policy, observation = rollout(name)
    assert policy.output(observation) == pytest.approx(float64_outputs(policy._layers, observation), rel=1e-5, abs=1e-5)


def test_row_bits_do_not_depend_on_batch_width() -> None:
    policy, observation = rollout("ppo")
    together = policy.output(observation)
    for width in (1, 2, 3, 16, 64, 65):
        parts = [policy.output(observation[first : first + width]) for first in range(0, len(observation), width)]
        assert np.array_equal(np.concatenate(parts), together), f"{width} rows at a time"


def test_tanh_is_accurate_odd_and_saturates_at_one() -> None:
    network = [(np.ones((1, 1), np.float32), np.zeros(1, np.float32))] * 2
    x = np.concatenate([np.linspace(-12, 12, 4001), [-1e30, 1e30]]).astype(np.float32)[:, None]
    out = forward(network, x)
    assert out == pytest.approx(np.tanh(x.astype(np.float64)), abs=4e-7)
    assert (out.min(), out.max()) == (-1.0, 1.0)
    assert np.array_equal(out[:4001], -out[4000::-1])
    assert np.isnan(forward(network, np.array([[np.nan]], np.float32))).all()


def test_every_activation_matches_torch() -> None:
    x = torch.linspace(-12, 12, 4001)[:, None]
    one = [(np.ones((1, 1), np.float32), np.zeros(1, np.float32))] * 2
    for name, function in ACTIVATIONS.items():
        assert forward(one, x.numpy(), name)[:, 0] == pytest.approx(function(x[:, 0].double()).numpy(), abs=4e-6), name
        assert np.isnan(forward(one, np.array([[np.nan]], np.float32), name)).all(), name
    assert set(ACTIVATIONS) == set(get_args(Activation))


def digest() -> str:
    network = layers((30, 21, 6))
    given = [forward(network, rows(7, 30), name) for name in get_args(Activation)]
    return hashlib.blake2b(np.stack(given).tobytes()).hexdigest()


@pytest.mark.nightly
def test_plain_python_gives_the_same_bits() -> None:
    program = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from tests.agents.test_forward import digest"
    program += "\nimport numba\nassert numba.config.DISABLE_JIT\nprint(digest())"
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout.strip() == digest(), done.stderr
