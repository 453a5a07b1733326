"""Test our policy gradient by hand, resuming to the bit, and killed, full-disk and diverging trainings."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file

from agents import make_policy, policy_config
from agents.networks import ActorCritic
from agents.weights_folder import Network, read_record
from tests.train.trainings import SMALL
from train.learning import checkpoint
from train.learning.config import HELD_OUT_SEED, PPOConfig, ReinforceConfig
from train.learning.progress import TrainingTally, figures_of
from train.learning.threaded import advantages, policy_loss
from train.learning.worlds import TrainingSimulator, TrainingWorlds
from train.trainers import train
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.errors import ConfigError, WarehouseError, WeightsError
from warehouse_env.traffic_spec import TRAFFIC


@pytest.fixture
def config(tmp_path: Path) -> ReinforceConfig:
    """Return a training of a few seconds: two worlds on the open floor, four updates."""
    return ReinforceConfig(out=tmp_path, steps=8 * 6 * 4, **SMALL)


def test_gradient_of_one_step_by_hand() -> None:
    net = ActorCritic(Network(2, 3, True, ()), np.array([0.5, 0.0, -0.5], np.float32))
    observation, action, advantage = np.array([0.3, -0.7], np.float32), 1, 2.0
    log_probability, entropy = net.judge(net.output(torch.from_numpy(observation[None])), torch.tensor([action]))
    (policy_loss(log_probability, log_probability, torch.tensor([advantage]))[0] - 0.1 * entropy.mean()).backward()
    weight, bias = (net.state_dict()[f"actor.0.{kind}"].numpy() for kind in ("weight", "bias"))
    p = np.exp(weight @ observation + bias)
    p /= p.sum()
    # d log pi(a) / d logit = one_hot(a) - p;  d H / d logit = -p (log p + H)
    h = -(p * np.log(p)).sum()
    by_logit = -advantage * (np.eye(3)[action] - p) - 0.1 * (-p * (np.log(p) + h))
    gradient = net.actor[0].get_parameter("weight").grad
    assert gradient is not None
    assert gradient.numpy() == pytest.approx(np.outer(by_logit, observation), abs=1e-6)


def test_advantages_equal_the_numpy_formula_to_the_bit() -> None:
    reward, value, last = np.random.default_rng(0).standard_normal((3, 10, 50), dtype=np.float32)
    ended, carried = last > 1.0, np.zeros(50, np.float32)
    got = advantages(*map(torch.from_numpy, (reward[:9], value, ended[:9], last[:9])), gamma=0.98, gae_lambda=0.95)
    for t in reversed(range(9)):
        delta = reward[t] + np.float32(0.98) * np.where(ended[t], last[t], value[t + 1]) - value[t]
        carried = delta + np.where(ended[t], np.float32(0), np.float32(0.98 * 0.95)) * carried
        assert np.array_equal(got[t], carried)


def test_training_saves_a_usable_policy(config: ReinforceConfig) -> None:
    folder = train(config)
    assert folder == config.out / "policy"
    env = policy_config(folder, EnvConfig(layout="open"))
    assert make_policy(folder, env) is not None
    training = read_record(folder).training
    assert (training["steps"], training["updates"], training["spent"]) == (config.steps, 4, 1.0)
    row = json.loads((folder / "progress.jsonl").read_text().splitlines()[-1])
    assert {"steps_per_second", "reward", "goals_per_robot_hour", "collisions_per_km", "stuck", "entropy"} <= set(row)
    card = (folder / "CARD.md").read_text()
    assert "192 agent-steps in 4 updates" in card
    assert not [path.name for path in folder.rglob(".*")]


def test_contacts_continue_in_restored_worlds() -> None:
    """A lasting contact is not counted again, although the first episode started with some age."""
    config = EnvConfig(num_agents=16, layout="paper46", planner="astar", max_steps=900)
    make = partial(TrainingSimulator, jam_seconds=1e6, shared=0.0)
    worlds, twin = (TrainingWorlds(make, [(config, 3)], [0]) for _ in range(2))
    simulator, its = worlds.simulators[0], twin.simulators[0]
    onwards = torch.full((worlds.rows,), int(simulator.cruise_action))
    for _ in range(250):
        worlds.step(onwards)
    assert (simulator.events.touching != 0).any()
    twin.replay(worlds.history())
    for _ in range(5):
        assert its.robots.tobytes() == simulator.robots.tobytes()
        np.testing.assert_array_equal(its.steps, simulator.steps)
        worlds.step(onwards)
        twin.step(onwards)


def test_finished_training_is_not_overwritten(config: ReinforceConfig) -> None:
    folder = train(config)
    before = (folder / "weights.safetensors").read_bytes()
    with pytest.raises(ConfigError, match=r"holds a training already: go on with --resume"):
        train(config)
    with pytest.raises(ConfigError, match=r"leave out gamma=0\.5"):
        train(ReinforceConfig(resume=folder, gamma=0.5))
    assert (folder / "weights.safetensors").read_bytes() == before


def test_resuming_without_a_valid_checkpoint_is_one_sentence(config: ReinforceConfig, tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="holds no checkpoint"):
        train(ReinforceConfig(resume=tmp_path / "nowhere"))
    folder = train(config)
    state = folder / "checkpoint" / "state.json"
    data = json.loads(state.read_text())
    state.write_text(json.dumps({**data, "algorithm": "ppo"}))
    with pytest.raises(WeightsError, match="was trained by ppo"):
        train(ReinforceConfig(resume=folder))
    state.write_text(json.dumps(data))
    arrays = next((folder / "checkpoint").glob("*.safetensors"))
    arrays.write_bytes(arrays.read_bytes()[:100])
    with pytest.raises(WeightsError, match="is damaged"):
        train(ReinforceConfig(resume=folder))


def test_tally_equals_the_episode_metrics() -> None:
    config = EnvConfig(layout="open", num_agents=8, planner="astar", max_steps=10**6)
    simulator = TrainingSimulator(config, 1, jam_seconds=1e6, shared=0.0)
    simulator.reset(seed=1)
    tally = TrainingTally([simulator])
    for _ in range(400):
        simulator.step(np.full((1, 8), simulator.cruise_action))
        tally.add()
    figures, metrics = figures_of([tally], 0.1), simulator.episode_metrics()
    for name in ("goals_per_robot_hour", "collisions_per_km", "path_length_ratio"):
        assert figures[name] == pytest.approx(metrics[name], rel=1e-5)
        assert figures[name] > 0
    assert set(figures_of([tally], 0.1).values()) == {0.0}


def test_stuck_robots_and_jammed_worlds_are_counted() -> None:
    """No robot moves: all are stuck after 1 s, worlds jam after 2 s, and the last world ends earlier by its age."""
    config = EnvConfig(layout="open", num_agents=5, planner="astar", max_steps=100, stuck_after=1.05)
    worlds = TrainingWorlds(partial(TrainingSimulator, jam_seconds=2.05, shared=0.0), [(config, 4)], [0, 0])
    stand = torch.full((worlds.rows,), 5)  # 0 m/s
    worlds.simulators[0].steps[:] = [0, 0, 0, 95]  # the last world has five steps left
    for _ in range(10):
        worlds.step(stand)
    young = figures_of([worlds.tally], 0.1)
    assert (young["stuck"], young["worlds_jammed"]) == (0.0, 0.0)
    for _ in range(12):
        worlds.step(stand)
    figures = figures_of([worlds.tally], 0.1)
    # stuck: steps 11 to 21 of three of four worlds (the 21st ends them), 6 to 12 of the other
    assert figures["stuck"] == pytest.approx((3 * 11 + 7) / (4 * 12))
    assert (figures["worlds_jammed"], figures["worlds_ended"]) == (pytest.approx(3 / 4), 4.0)
    assert figures_of([worlds.tally], 0.1)["worlds_jammed"] == pytest.approx(3 / 4)  # of the last ended worlds


def test_training_worlds_spread_ends_and_avoid_held_out_seeds(config: ReinforceConfig) -> None:
    make = partial(TrainingSimulator, jam_seconds=100.0, shared=0.0)
    worlds = TrainingWorlds(make, [(config.env("open", 2), 5)], [0, 0])
    ends = []
    for step in range(15):
        ends += [step for _ in worlds.step(torch.full((worlds.rows,), 15))]
    assert ends == [2, 5, 8, 11, 14]  # episodes of 15 steps, five worlds
    assert max(worlds._world_seed(world) for world in range(5)) < HELD_OUT_SEED


def test_shared_reward_mixes_in_the_mean_of_nearby_robots() -> None:
    config = EnvConfig(layout="open", num_agents=3, planner="astar")
    alone, sharing = (TrainingSimulator(config, 1, 60.0, shared) for shared in (0.0, 0.25))
    for simulator in (alone, sharing):
        simulator.reset(seed=5)
        pose = [[[10.0, 10.0, 0.0], [14.0, 10.0, 1.0], [30.0, 30.0, 2.0]]]  # 4 m apart, and far from both
        simulator.put(pose, [[0.0, 0.0, 0.0]])
    commands = np.array([[int(alone.cruise_action), 5, int(alone.cruise_action)]])
    for _ in range(5):
        alone.step(commands)
        sharing.step(commands)
    own = alone.reward[0]
    assert abs(own[0] - own[1]) > 0.01
    pair = (own[0] + own[1]) / 2
    assert sharing.reward[0] == pytest.approx([0.75 * own[0] + 0.25 * pair, 0.75 * own[1] + 0.25 * pair, own[2]])


def test_late_braking_costs_by_the_metre() -> None:
    """A robot drives fast at a standing one; once it cannot stop clear, each metre costs."""
    config = EnvConfig(layout="open", num_agents=2, planner="astar", sensor=SensorSpec(predictions=True))
    priced, plain = (TrainingSimulator(config, 1, 1e6, 0.0, late_braking=price) for price in (-40.0, 0.0))
    stand = config.speed_levels.index(0.0) * len(config.lateral_offsets)
    poses = np.array([[[10.0, 10.5, 0.0], [11.8, 10.5, 0.0]]])
    for simulator in (priced, plain):
        simulator.reset(0)
        simulator.put(poses, np.array([[1.5, 0.0]]))
        simulator.step(np.full((1, 2), stand))
    free = priced.observation[0, :, priced.layout.slices["predictions"].start + stand]
    assert free[0] <= 0.25
    metres = abs(priced.robots["motion"]["speed"][0, 0]) * 0.1
    np.testing.assert_allclose(priced.reward - plain.reward, [[-40.0 * metres, 0.0]], rtol=1e-4)


def test_policy_adds_the_right_of_way_omitted_in_training(config: ReinforceConfig) -> None:
    config = replace(config, traffic="assist:right_of_way_after=6", steps=8 * 6)
    assert not config.env("open", 2).traffic_spec.right_of_way
    directory = train(config)
    driven = policy_config(directory, EnvConfig())
    assert driven.traffic_spec == replace(TRAFFIC["assist"], right_of_way_after=6.0)
    assert "right_of_way_after=6.0" in (directory / "CARD.md").read_text()
    plain = train(replace(config, name="plain", traffic="shield"))
    assert not policy_config(plain, EnvConfig()).traffic_spec.right_of_way
    assert (read_record(directory).mode, read_record(plain).mode) == ("greedy", "sample")
    assert (plain / "weights.safetensors").read_bytes() == (directory / "weights.safetensors").read_bytes()


ROOT = Path(__file__).parents[2]


def weights(folder: Path) -> dict[str, np.ndarray[Any, Any]]:
    return load_file(folder / "weights.safetensors")


@pytest.mark.nightly
def test_repeatedly_killed_commands_give_the_same_files() -> None:
    command = [sys.executable, "-m", "tests.kills", "--kills", "8"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "to the same files as undisturbed" in done.stdout


def test_non_finite_weights_are_not_saved(tmp_path: Path) -> None:
    begun = train(PPOConfig(out=tmp_path, steps=8 * 6, **SMALL))
    good = weights(begun)
    saved = checkpoint.read(begun / "checkpoint")
    data = saved.data | {"config": saved.data["config"] | {"learning_rate": 1e9, "gradient_clip": 1e9, "steps": 10**6}}
    arrays = saved.arrays | {
        name: array * 1e38 for name, array in saved.arrays.items() if "critic" in name and name.endswith("weight")
    }
    checkpoint.write(begun / "checkpoint", arrays, data)
    config = PPOConfig(resume=begun, progress=False)
    with pytest.raises(WarehouseError, match=r"weights that are not finite.*last good ones.*--learning-rate"):
        train(config)
    for name, tensor in weights(begun).items():
        np.testing.assert_array_equal(tensor, good[name])
    make_policy(begun, policy_config(begun, EnvConfig()))


def test_full_disk_is_one_sentence_and_keeps_the_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = train(ReinforceConfig(out=tmp_path, steps=8 * 6, **SMALL))
    before = (folder / "checkpoint" / "state.json").read_bytes()
    saved = checkpoint.read(folder / "checkpoint")
    longer = saved.data["config"] | {"steps": 8 * 6 * 4}
    checkpoint.write(folder / "checkpoint", saved.arrays, saved.data | {"config": longer})
    kept = (folder / "checkpoint" / "state.json").read_bytes()
    assert kept != before

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    config = ReinforceConfig(resume=folder, progress=False)
    with pytest.raises(WarehouseError, match=r"cannot write .*No space left on device"):
        train(config)
    assert (folder / "checkpoint" / "state.json").read_bytes() == kept
    monkeypatch.undo()
    assert train(config) == folder
