"""Training on a device: the rewards, jams and counts of the CPU's worlds, and what is refused."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
import torch

from train.cli import main
from train.learning.config import ReinforceConfig
from train.learning.device_worlds import DeviceWorlds, TrainingDevice
from train.learning.worlds import TrainingSimulator, TrainingWorlds
from warehouse_env.config import RewardWeights

CONFIG = ReinforceConfig(layouts=("narrow",), planner="astar_turns", traffic="none:shield=true", episode_seconds=60.0)


def test_a_device_trains_in_the_worlds_of_the_cpu() -> None:
    """The same observations, rewards and counts until a world ends; a jam ends it one step later."""
    env = CONFIG.env("narrow", 8)
    here = TrainingWorlds([TrainingSimulator(env, 3, 8.0, 0.3)], [5])
    there = DeviceWorlds([TrainingDevice(env, 3, 8.0, 0.3, "cpu")], [5])
    actions = torch.full((24,), int(here.simulators[0].cruise_action))
    mine: Sequence[object] = ()
    actions[8:] = 5  # two worlds stand
    for worlds in (here, there):
        worlds.set_reward(RewardWeights(progress=2.0, collision=-7.0))
    while not mine:
        assert torch.equal(here.observation, there.observation)
        mine = here.step(actions)
        assert not there.step(actions)
        assert there.reward.tolist() == pytest.approx(here.reward.tolist(), abs=1e-6)
    assert here.simulators[0].ends == [True, True]
    counted, its = (worlds.tally.take().figures(0.2) for worlds in (here, there))
    assert its == pytest.approx(counted | {"worlds_ended": 0.0, "worlds_jammed": 0.0}, rel=1e-5)
    last = there.observation.clone()
    [(rows, final)] = there.step(actions)
    assert there.simulators[0].ends == [True, True]
    assert torch.arange(24)[rows].tolist() == list(range(8, 24))
    assert final.shape == (16, last.shape[1])
    assert there.simulators[0].steps.tolist() == [here.simulators[0].steps[0] + 1, 0, 0]
    assert not torch.equal(there.observation[rows], final)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--device", "cpu"], "a device does not simulate live routes yet: leave that out"),
        (["--device", "cuda", "--recipe", "device"], "device='cuda'"),
    ],
)
def test_what_cannot_be_trained_on_a_device_is_one_sentence(
    words: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if "cuda" in words and torch.cuda.is_available():
        pytest.skip("this machine has a GPU")
    assert main(["train", "threaded_ppo", *words, "--out", str(tmp_path)]) == 2
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
