"""Test what REINFORCE and our PPO share: thread mixes, resuming to the bit, starts, drawn floors, plan tables."""

from __future__ import annotations

import weakref
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file
from torch import Tensor

from agents.networks import begin_with
from agents.weights_folder import PolicyRecord, read_record, save_policy
from tests.train.trainings import SMALL
from train import books
from train.learning.config import ReinforceConfig, ThreadedConfig, ThreadedPPOConfig, TrainingConfig
from train.learning.device_worlds import ROUND, DeviceWorlds, TrainingDevice
from train.learning.plan_ahead import plan_ahead
from train.learning.progress import figures_of
from train.learning.threaded import ThreadedTrainer, shares
from train.learning.worlds import TrainingSimulator, TrainingWorlds
from train.trainers import held_out, train
from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.errors import ConfigError, WeightsError
from warehouse_env.simulation.device.memory import field_on_device
from warehouse_env.simulation.state import OWNER
from warehouse_env.traffic_spec import UncertaintySpec

T = TypeVar("T")
SIXTEEN = SMALL | {"rows": 16, "steps": 16 * 6 * 8, "traffic": "none:shield=true"}


@pytest.mark.parametrize(("threads", "device"), [(2, None), (3, None), (1, "cpu")])
@pytest.mark.parametrize("options", [ReinforceConfig, ThreadedPPOConfig])
def test_resumed_training_equals_an_unbroken_one_to_the_bit(
    options: type[ThreadedConfig], threads: int, device: str | None, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    layouts = ("open",) if device else ("open", "aisles:seed=new")
    kind = {"threads": threads, "layouts": layouts, "late_braking": -3.0} | ({"traffic": "shield"} if device else {})
    config = options(out=tmp_path, device=device, **SIXTEEN | kind)
    whole = load_file(train(replace(config, name="whole")) / "weights.safetensors")
    update, calls = ThreadedTrainer.update, []

    def broken(self: ThreadedTrainer, number: int, spent: float) -> dict[str, float]:
        calls.append(number)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return update(self, number, spent)

    monkeypatch.setattr(ThreadedTrainer, "update", broken)
    with pytest.raises(KeyboardInterrupt):
        train(replace(config, name="parts"))
    monkeypatch.setattr(ThreadedTrainer, "update", update)
    folder = train(options(resume=tmp_path / "parts", progress=False))
    parts = load_file(folder / "weights.safetensors")
    assert read_record(folder).training["updates"] == read_record(tmp_path / "whole").training["updates"]
    assert whole.keys() == parts.keys()
    assert all(np.array_equal(whole[name], parts[name]) for name in whole)
    assert 0.0 <= held_out(replace(config, name="parts"))["stuck"] <= 1.0


def test_mixes_are_dealt_evenly_to_threads() -> None:
    config = ReinforceConfig(layouts=("open", "narrow"), robots=(8, 16, 32), rows=384, threads=2)
    dealt = [[(env.layout, env.num_agents, worlds) for env, worlds in share] for share in shares(config)]
    assert dealt == [
        [("open", 8, 8), ("open", 32, 2), ("narrow", 16, 4)],
        [("open", 16, 4), ("narrow", 8, 8), ("narrow", 32, 2)],
    ]
    halves = shares(replace(config, robots=(8,), layouts=("open",)))
    assert [[(env.num_agents, worlds) for env, worlds in share] for share in halves] == [[(8, 24)], [(8, 24)]]


def test_device_worlds_equal_cpu_worlds() -> None:
    """Observations, rewards and counts agree until a world ends; on a device a jam ends its round."""
    env = ReinforceConfig(planner="astar_turns", traffic="none:shield=true", episode_seconds=60.0).env("narrow", 8)
    here = TrainingWorlds(partial(TrainingSimulator, jam_seconds=8.0, shared=0.3), [(env, 3)], [5])
    there = DeviceWorlds(partial(TrainingDevice, jam_seconds=8.0, shared=0.3), [(env, 3)], [5], "cpu")
    actions = torch.full((24,), int(here.simulators[0].cruise_action))
    mine: object = None
    actions[8:] = 5  # the robots of two worlds stand
    for worlds in (here, there):
        worlds.set_reward(RewardWeights(progress=2.0, collision=-7.0))
    while not mine:
        assert torch.equal(here.observation, there.observation)
        mine = here.step(actions)
        assert not there.step(actions)
        assert there.reward.tolist() == pytest.approx(here.reward.tolist(), abs=1e-6)
    assert here.simulators[0].ends == [True, True]
    counted, its = (figures_of([worlds.tally], 0.2) for worlds in (here, there))
    assert its == pytest.approx(counted | {"worlds_ended": 0.0, "worlds_jammed": 0.0}, rel=1e-5)
    ended: list[tuple[torch.Tensor, torch.Tensor]] = []
    while not ended:
        ended = there.step(actions)
    [(rows, final)] = ended
    assert there.simulators[0].ends == [True, True]
    assert rows.tolist() == list(range(8, 24))
    first, *others = there.simulators[0].steps.tolist()
    assert first == -(-(here.simulators[0].steps[0] + 1) // ROUND) * ROUND
    assert others == [0, 0]
    assert not torch.equal(there.observation[rows], final)


@pytest.mark.parametrize("errors", [UncertaintySpec(), UncertaintySpec(pose_error=0.05, actuation_error=0.1)])
def test_device_training_reads_the_present_states(errors: UncertaintySpec) -> None:
    worlds = TrainingDevice(EnvConfig(num_agents=4, layout="paper46", uncertainty=errors), 2, 0.0, 0.0, "cpu")
    worlds.reset(0)
    for _ in range(5):
        worlds.step(torch.full((2, 4), 8))
    for name in ("x", "speed", "stalled_time"):
        assert torch.equal(worlds.fields[OWNER[name]][name], field_on_device(worlds.robots, name))


@pytest.fixture
def config(tmp_path: Path) -> ThreadedPPOConfig:
    """Return a training of a few seconds."""
    return ThreadedPPOConfig(out=tmp_path, steps=16 * 6 * 4, **SMALL | {"rows": 16, "threads": 1})


def saved(trainer: ThreadedTrainer, config: ThreadedPPOConfig, folder: Path) -> Path:
    """Save a trainer's policy."""
    record = PolicyRecord("ours", trainer.network, config.driven(trainer.env))
    return save_policy(folder, record, trainer.policy_tensors())


def test_training_starts_from_a_policy(config: ThreadedPPOConfig, tmp_path: Path) -> None:
    first = ThreadedTrainer(config)
    first.update(0, 0.0)
    seen = torch.randn(10, first.network.observation_size)
    started = ThreadedTrainer(replace(config, start=str(saved(first, config, tmp_path / "first"))))
    assert torch.equal(started.net.output(seen), first.net.output(seen))
    assert torch.equal(started.net.value(seen), first.net.value(seen))
    actor = {name: array for name, array in first.policy_tensors().items() if not name.startswith("critic.")}
    begin_with(started.net, actor)
    wide = ThreadedTrainer(replace(config, hidden=(40, 40)))
    with pytest.raises(ConfigError, match=r"actor\.0\.weight"):
        begin_with(wide.net, actor)
    with pytest.raises(ConfigError, match="rule"):
        ThreadedTrainer(replace(config, start="brake"))


def test_start_policy_with_other_observations_is_refused(config: ThreadedPPOConfig, tmp_path: Path) -> None:
    folder = saved(ThreadedTrainer(replace(config, predictions=False)), config, tmp_path / "blind")
    with pytest.raises(WeightsError, match=r"112|112 values|made for"):
        ThreadedTrainer(replace(config, start=str(folder)))


def test_update_reproduces_the_rollouts_probabilities(
    config: ThreadedPPOConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the first step the probabilities equal those of the draws."""
    trainer = ThreadedTrainer(replace(config, minibatch=1000))

    def compared(log_probability: Tensor, old: Tensor, advantage: Tensor) -> tuple[Tensor, Tensor]:
        assert torch.allclose(log_probability, old, atol=1e-5)
        return (advantage * log_probability).mean(), advantage.new_zeros(())

    monkeypatch.setattr(trainer, "_actor_loss", compared)
    monkeypatch.setattr(trainer, "epochs", 1)
    with torch.no_grad():
        for parameter in trainer.net.actor_parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    for number in range(2):
        trainer.update(number, 0.0)


def _worlds(seed: int = 3) -> TrainingWorlds:
    """Return worlds on one fixed and two drawn floors; a drawn floor lasts for two episodes of 15 steps."""
    layouts = ("open", "aisles:seed=new,rows=24")
    mixes = ThreadedPPOConfig(**SMALL | {"layouts": layouts, "robots": (16,), "traffic": "none"}).worlds(256)
    return TrainingWorlds(partial(TrainingSimulator, jam_seconds=60.0, shared=0.0), mixes, [seed, 0], 2)


def _floors(worlds: TrainingWorlds) -> list[str]:
    return [simulator.config.layout for simulator in worlds.simulators]


def _drive(worlds: TrainingWorlds, steps: int) -> list[list[int]]:
    """Return the rows whose episodes end, per step."""
    onwards = torch.full((worlds.rows,), int(worlds.simulators[0].cruise_action))
    return [[row for rows, _ in worlds.step(onwards) for row in rows.tolist()] for _ in range(steps)]


def test_floors_change_in_turn_and_free_their_memory() -> None:
    worlds = _worlds()
    seen, kept = [_floors(worlds)], books._books.copy()
    book, fixed = weakref.ref(worlds.simulators[1].route_book), worlds.simulators[0]
    for _ in range(4):
        last = _drive(worlds, 15)[-1]
        seen.append(_floors(worlds))
        changed = [number for number in (1, 2) if seen[-1][number] != seen[-2][number]]
        assert changed == [2 - len(seen) % 2]  # the second floor after 15 and 45 steps, the first after 30 and 60
        first = 64 * (1 + changed[0])
        assert set(range(first, first + 64)) <= set(last)  # all episodes of the changed floor end
    drawn = {layout for floors in seen for layout in floors[1:]}
    assert len(drawn) == 6
    assert all(1_000_000 <= int(layout.split("=")[1].split(",")[0]) < 900_000_000 for layout in drawn)
    assert all(simulator.grid.shape[0] == 24 for simulator in worlds.simulators[1:])
    assert drawn.isdisjoint(_floors(_worlds(seed=4)))
    assert worlds.simulators[0] is fixed
    assert book() is None
    assert books._books == kept


@pytest.mark.parametrize("steps", [0, 5, 15, 20, 47])
def test_history_restores_worlds_and_floors(steps: int) -> None:
    """Worlds that replay a history continue like the original ones, also after an empty history."""
    worlds, twin = _worlds(), _worlds()
    _drive(worlds, steps)
    twin.replay(worlds.history())
    for _ in range(33):
        assert _floors(twin) == _floors(worlds)
        for mine, its in zip(worlds.simulators, twin.simulators, strict=True):
            assert mine.robots.tobytes() == its.robots.tobytes()
        assert torch.equal(worlds.observation, twin.observation)
        assert _drive(worlds, 1) == _drive(twin, 1)


@pytest.mark.parametrize(("steps", "traffic"), [(10**9, "none"), (1000, "none"), (10**9, "routes")])
def test_training_makes_plan_tables_only_if_they_pay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: int, traffic: str
) -> None:
    monkeypatch.setenv("WAREHOUSE_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(books, "_books", {})
    floor = tmp_path / "small.map"
    floor.write_text("type octile\nheight 3\nwidth 4\nmap\n....\n.@@.\n....\n")
    config = TrainingConfig(layouts=(str(floor),), robots=(1, 2), steps=steps, traffic=traffic, planner="pf_aco")
    plan_ahead(config)
    pays = steps > 1000 and traffic == "none"  # live routes of pf_aco use no plan table
    assert books.book_of(config.env(str(floor), 1)).has_table == pays
    assert len(list(tmp_path.glob("plans-*.npz"))) == pays
