"""Floors drawn while a policy trains: they change, follow from the seed, and leave nothing behind."""

from __future__ import annotations

import weakref
from functools import partial

import pytest
import torch

from tests.train.trainings import SMALL
from train import books, ppo
from train.learning.config import PPOConfig, ThreadedPPOConfig
from train.learning.floors import FIRST_SEED, HELD_OUT_FLOORS
from train.learning.worlds import TrainingSimulator, TrainingWorlds
from warehouse_env.errors import ConfigError

NEW = SMALL | {"layouts": ("open", "aisles:seed=new,rows=24"), "robots": (16,), "rows": 256, "planner": "astar"}


def _worlds(seed: int = 3) -> TrainingWorlds:
    mixes = ThreadedPPOConfig(**NEW).worlds(256)
    return TrainingWorlds(partial(TrainingSimulator, jam_seconds=60.0, shared=0.0), mixes, [seed, 0], 2)


def _floors(worlds: TrainingWorlds) -> list[str]:
    return [simulator.config.layout for simulator in worlds.simulators]


def _drive(worlds: TrainingWorlds, steps: int) -> list[tuple[int, int]]:
    """Return (step, row) of the ends of episodes."""
    onwards = torch.full((worlds.rows,), int(worlds.simulators[0].cruise_action))
    return [(step, row) for step in range(steps) for rows, _ in worlds.step(onwards) for row in rows.tolist()]


def test_floors_change_in_turn_when_their_episodes_end() -> None:
    """Two floors of four worlds, each for two episodes of 15 steps."""
    worlds = _worlds()
    seen, books_before = [_floors(worlds)], len(books._books)
    book, fixed = weakref.ref(worlds.simulators[1].route_book), worlds.simulators[0]
    ends = _drive(worlds, 15)
    seen.append(_floors(worlds))
    ends += [(15 + step, row) for step, row in _drive(worlds, 15)]
    seen.append(_floors(worlds))
    assert [len(set(column)) for column in zip(*seen, strict=True)] == [1, 2, 2]
    assert seen[0][1] == seen[1][1] != seen[2][1]
    assert seen[0][2] != seen[1][2] == seen[2][2]
    drawn = [layout for floors in seen for layout in floors[1:]]
    assert all(layout.endswith(",rows=24") for layout in drawn)
    assert all(FIRST_SEED <= int(layout[12:-8]) < HELD_OUT_FLOORS for layout in drawn)
    assert {step for step, row in ends if row >= 128} == {14, 29}
    assert worlds.simulators[0] is fixed
    assert book() is None
    assert len(books._books) == books_before


def test_floors_follow_from_the_seed() -> None:
    one, same, other = _worlds(), _worlds(), _worlds(seed=4)
    assert _floors(one) == _floors(same)
    assert set(_floors(one)[1:]).isdisjoint(_floors(other))
    assert len(set(_floors(one))) == 3
    for worlds in (one, same):
        _drive(worlds, 33)
    assert torch.equal(one.observation, same.observation)


@pytest.mark.parametrize("steps", [5, 15, 20, 47])
def test_worlds_are_brought_back_on_their_floors(steps: int) -> None:
    worlds, twin = _worlds(), _worlds()
    _drive(worlds, steps)
    twin.replay(worlds.history())
    for _ in range(20):
        assert _floors(twin) == _floors(worlds)
        for mine, its in zip(worlds.simulators, twin.simulators, strict=True):
            assert mine.robots.tobytes() == its.robots.tobytes()
            assert mine.steps.tolist() == its.steps.tolist()
        assert torch.equal(worlds.observation, twin.observation)
        assert _drive(worlds, 1) == _drive(twin, 1)


def test_who_cannot_draw_floors_says_so() -> None:
    with pytest.raises(
        ConfigError, match=r"needs threaded_ppo or reinforce on the CPU: choose seeds, as in aisles:seed=1"
    ):
        ThreadedPPOConfig(layouts=("aisles:seed=new",), device="cpu", traffic="none")
    with pytest.raises(ConfigError, match="needs threaded_ppo or reinforce"):
        ppo.train(PPOConfig(layouts=("aisles:seed=new",)))
