"""`rules` on hand-made observations: one for each of paper 001's conflicts."""

from __future__ import annotations

import numpy as np
import pytest

from agents.rules import RuleNumbers, Rules
from tests.agents.conftest import Observe
from tests.agents.test_potential_field import seen
from warehouse_env.config import EnvConfig
from warehouse_env.observation import observation_layout

CONFIG = EnvConfig()
WIDE = RuleNumbers(range=4.0)


def command(policy: Rules, observation: np.ndarray, seed: int = 0) -> tuple[float, float]:  # type: ignore[type-arg]
    action = int(policy.act(observation, np.random.default_rng(seed))[0, 0])
    return CONFIG.speed_levels[action // 5], CONFIG.lateral_offsets[action % 5]


def moving(observation: np.ndarray, vx: float, vy: float) -> np.ndarray:  # type: ignore[type-arg]
    """Give the neighbour a velocity [m/s] relative to the own."""
    start = observation_layout(CONFIG).slices["neighbours"].start
    observation[..., start + 4 : start + 6] = np.array([vx, vy]) / CONFIG.robot.max_speed
    return observation


def test_alone_it_cruises_on_the_route(observe: Observe) -> None:
    assert command(Rules(CONFIG, WIDE), seen(observe, CONFIG)) == (1.5, 0.0)


@pytest.mark.parametrize(
    ("other", "turn", "waits"),
    [
        ((2.5, -2.5), np.pi / 2, True),  # as far from the node as itself, from the right
        ((2.5, 2.5), -np.pi / 2, False),  # from the left
        ((2.5, 1.5), -np.pi / 2, True),  # from the left, but a body's length nearer
        ((2.5, -3.6), np.pi / 2, False),  # from the right, but further
        ((2.5, 2.5), np.pi / 2, False),  # past the node
    ],
)
def test_at_a_node_the_nearer_goes_first_else_who_comes_from_the_right(
    observe: Observe, other: tuple[float, float], turn: float, waits: bool
) -> None:
    observation = moving(seen(observe, CONFIG, other=other, turn=turn), 0.0, np.sin(turn))
    assert command(Rules(CONFIG, WIDE), observation)[0] == (0.0 if waits else 1.5)


def test_exactly_one_of_two_at_a_node_waits(observe: Observe) -> None:
    """The same meeting as both see it: who waits is agreed on without a word."""
    rng, policy = np.random.default_rng(4), Rules(CONFIG, WIDE)
    for _ in range(200):
        own, others = rng.uniform(0.8, 3.0, 2)  # [m] to the node
        turn = rng.uniform(0.9, 2.2) * rng.choice([-1, 1])
        x, y = own - others * np.cos(turn), -others * np.sin(turn)
        back_x, back_y = -x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) - y * np.cos(turn)
        waits = []
        for place, angle in (((x, y), turn), ((back_x, back_y), -turn)):
            observation = moving(
                seen(observe, CONFIG, speed=1.0, other=place, turn=angle), np.cos(angle) - 1, np.sin(angle)
            )
            near = policy._surroundings.neighbours(observation)
            waits.append(bool(policy.must_wait(near, np.ones((1, 1))).any()))
        assert sum(waits) == 1


def test_head_on_both_step_aside_to_where_it_is_free(observe: Observe) -> None:
    observation = seen(observe, CONFIG, other=(3.5, 0.0), turn=np.pi)
    assert command(Rules(CONFIG, WIDE), observation) == (0.5, -0.6)
    lidar = observation_layout(CONFIG).slices["lidar"].start
    observation[..., lidar + 24] = 1 / (1 + 0.3 + 0.2)  # a shelf 0.2 m off the right side
    assert command(Rules(CONFIG, WIDE), observation) == (0.5, 0.6)
    observation[..., lidar + 8] = 1 / (1 + 0.3 + 0.2)  # and one on the left
    assert command(Rules(CONFIG, WIDE), observation) == (0.5, 0.0)


def test_nose_to_nose_it_waits_and_then_backs_by_chance(observe: Observe) -> None:
    policy = Rules(CONFIG, RuleNumbers(begins=0.5))
    observation = seen(observe, CONFIG, other=(1.1, 0.0), turn=np.pi)
    assert {command(policy, observation, seed)[0] for seed in range(20)} == {0.0}
    observation[..., observation_layout(CONFIG).slices["ego"].start + 7] = 10 / 20  # standing for 10 s
    assert {command(policy, observation, seed)[0] for seed in range(20)} == {0.0, -0.4}
