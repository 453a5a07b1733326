"""What REINFORCE and our PPO share: how mixes are dealt to threads, one book of routes, resuming to the bit."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, TypeVar

import numpy as np
import pytest
from safetensors.numpy import load_file

from agents.weights_folder import read_record
from train import reinforce, threaded_ppo
from train.learning import progress
from train.learning.config import ReinforceConfig, ThreadedConfig, ThreadedPPOConfig
from train.learning.crew import Threads
from train.learning.threaded import ThreadedTrainer
from train.reporting.rows import read_rows
from warehouse_env.errors import LostError, WeightsError
from warehouse_env.maps.movingai import EXAMPLE_MAP

T = TypeVar("T")
SMALL: dict[str, Any] = {
    "layouts": ("open",), "robots": (2, 4), "rows": 16, "planner": "astar", "steps": 16 * 6 * 8, "rollout": 6,
    "minibatch": 24, "hidden": (24,), "episode_seconds": 3.0, "checkpoint_seconds": 0.0, "progress": False,
}  # fmt: skip
TRAINERS = [(reinforce, ReinforceConfig), (threaded_ppo, ThreadedPPOConfig)]


@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize(("module", "options"), TRAINERS)
def test_a_resumed_run_gives_the_same_bits_as_an_unbroken_one(
    module: ModuleType, options: type[ThreadedConfig], threads: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = options(out=tmp_path, threads=threads, **SMALL)
    whole = load_file(module.train(replace(config, name="whole")) / "weights.safetensors")
    update, calls = ThreadedTrainer.update, []

    def broken(self: ThreadedTrainer, number: int, spent: float) -> dict[str, float]:
        calls.append(number)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return update(self, number, spent)

    monkeypatch.setattr(ThreadedTrainer, "update", broken)
    with pytest.raises(KeyboardInterrupt):
        module.train(replace(config, name="parts"))
    monkeypatch.setattr(ThreadedTrainer, "update", update)
    folder = module.train(options(resume=tmp_path / "parts", progress=False))
    parts = load_file(folder / "weights.safetensors")
    assert read_record(folder).training["updates"] == read_record(tmp_path / "whole").training["updates"]
    assert whole.keys() == parts.keys()
    assert all(np.array_equal(whole[name], parts[name]) for name in whole)


def test_whole_mixes_are_dealt_out_where_they_go_round() -> None:
    config = ReinforceConfig(layouts=("open", "narrow"), robots=(8, 16, 32), rows=384, threads=2)
    dealt = [[(env.layout, env.num_agents, worlds) for env, worlds in share] for share in config.shares()]
    assert dealt == [
        [("open", 8, 8), ("open", 32, 2), ("narrow", 16, 4)],
        [("open", 16, 4), ("narrow", 8, 8), ("narrow", 32, 2)],
    ]
    halves = replace(config, robots=(8,), layouts=("open",)).shares()
    assert [[(env.num_agents, worlds) for env, worlds in share] for share in halves] == [[(8, 24)], [(8, 24)]]


class Losing(Threads):
    """Loses a worker at each piece of work whose number, over all crews, is in `lost`."""

    lost: ClassVar[set[int]]
    done: ClassVar[Iterator[int]]

    def each(self, work: Callable[..., T], arguments: Sequence[tuple[Any, ...]]) -> list[T]:
        if next(self.done) in self.lost:
            raise LostError("a worker is gone")
        return super().each(work, arguments)


def test_a_training_that_loses_workers_goes_on_from_its_checkpoint_to_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wherever it loses them: as they are made or go back, in a rollout, in a gradient, or as it saves."""
    monkeypatch.setattr(progress, "LOG_SECONDS", 0.0)
    config = ReinforceConfig(out=tmp_path, threads=2, **SMALL, evaluation_seconds=0.0)
    whole = reinforce.train(replace(config, name="whole"))
    monkeypatch.setattr(Losing, "lost", {0, 2, 6, 16, 18, 26, 35}, raising=False)
    monkeypatch.setattr(Losing, "done", itertools.count(), raising=False)
    losing = reinforce.train(replace(config, name="losing"), Losing)
    assert (losing / "weights.safetensors").read_bytes() == (whole / "weights.safetensors").read_bytes()
    assert [row["steps"] for row in read_rows(losing / "progress.jsonl")] == [96 * n for n in range(1, 9)]


def test_new_workers_do_not_train_on_a_map_that_has_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    floor = Path(shutil.copy(EXAMPLE_MAP, tmp_path / "mine.map"))

    def change(number: int) -> int:
        if number == 20:
            floor.write_bytes(floor.read_bytes() + b" ")
        return number

    config = ReinforceConfig(out=tmp_path, threads=2, **SMALL | {"layouts": (str(floor),)}, evaluation_seconds=0.0)
    monkeypatch.setattr(Losing, "lost", {20}, raising=False)
    monkeypatch.setattr(Losing, "done", map(change, itertools.count()), raising=False)
    with pytest.raises(WeightsError, match=r"the files of .*mine\.map are not those that"):
        reinforce.train(config, Losing)


def test_workers_lost_again_and_again_are_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = ReinforceConfig(out=tmp_path, threads=2, **SMALL, evaluation_seconds=0.0)
    monkeypatch.setattr(Losing, "lost", set(range(12, 1000)), raising=False)
    monkeypatch.setattr(Losing, "done", itertools.count(), raising=False)
    with pytest.raises(LostError, match=r"^a worker is gone, 6 times before the next checkpoint; go on with --resume "):
        reinforce.train(config, Losing)
    whole = reinforce.train(replace(config, name="whole"))
    folder = reinforce.train(ReinforceConfig(resume=config.directory, progress=False))
    assert (folder / "weights.safetensors").read_bytes() == (whole / "weights.safetensors").read_bytes()
