"""One training over machines: the bits of threads, also after an actor or a machine is killed, and gone on with."""

from __future__ import annotations

import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.xdist_group("ray")

from train import reinforce, threaded_ppo  # noqa: E402
from train.learning import progress  # noqa: E402
from train.learning.actors import Actors  # noqa: E402
from train.learning.config import ReinforceConfig, ThreadedPPOConfig  # noqa: E402
from train.learning.threaded import ThreadedTrainer  # noqa: E402
from train.own import take_in  # noqa: E402
from train.reporting.rows import read_rows  # noqa: E402
from warehouse_env.errors import LostError, MapError  # noqa: E402
from warehouse_env.maps.movingai import EXAMPLE_MAP  # noqa: E402

UPDATES = 6
SMALL: dict[str, Any] = {
    "layouts": ("open",), "robots": (2, 4), "rows": 16, "planner": "astar", "steps": 16 * 6 * UPDATES, "rollout": 6,
    "minibatch": 24, "hidden": (24,), "episode_seconds": 3.0, "evaluation_seconds": 0.0, "threads": 2,
    "progress": False,
}  # fmt: skip
OWN = """
from warehouse_env.maps.generators import open_floor

def hall():
    return open_floor()
"""


def weights(folder: Path) -> bytes:
    return (folder / "weights.safetensors").read_bytes()


def ask(trainer: ThreadedTrainer, number: int, question: Any) -> Any:
    """Return what a function returns in the process of a worker."""
    crew = trainer._crew
    assert isinstance(crew, Actors)
    return ray.get(crew._actors[number].__ray_call__.remote(question))


def kill_one(trainer: ThreadedTrainer) -> None:
    """Kill the process of a training's second worker."""
    os.kill(ask(trainer, 1, lambda _: os.getpid()), signal.SIGKILL)


def before_update(monkeypatch: pytest.MonkeyPatch, call: int, act: Any) -> None:
    """Call `act(trainer)` once, before the update of this number."""
    update, acted = ThreadedTrainer.update, []

    def disturbed(self: ThreadedTrainer, number: int, spent: float) -> dict[str, float]:
        if number == call and not acted:
            acted.append(number)
            act(self)
        return update(self, number, spent)

    monkeypatch.setattr(ThreadedTrainer, "update", disturbed)


def test_actors_learn_the_same_bits_as_threads_on_floors_of_files_and_code(
    registries: None, connected_nodes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With real-valued actions; the optimizer, the worlds and the figures in the log are the same as well."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "floors").mkdir()
    shutil.copy(EXAMPLE_MAP, tmp_path / "floors" / "mine.map")
    (tmp_path / "mine.py").write_text(OWN)
    take_in([("layout", "mine.py:hall")])
    config = ReinforceConfig(**SMALL | {"layouts": ("floors/mine.map", "mine.py:hall")}, action_type="continuous")
    folders = [
        reinforce.train(replace(config, name="threads")),
        reinforce.train(replace(config, name="actors"), Actors),
    ]
    for file in ("weights.safetensors", f"checkpoint/arrays-{UPDATES}.safetensors"):
        assert len({(folder / file).read_bytes() for folder in folders}) == 1
    threads, actors = (read_rows(folder / "progress.jsonl")[-1] for folder in folders)
    times = {"seconds", "steps_per_second"}
    assert {key: threads[key] for key in threads.keys() - times} == {key: actors[key] for key in actors.keys() - times}


@pytest.mark.nightly
def test_with_an_actor_killed_it_comes_to_the_same_bits(
    connected_nodes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It goes back to the beginning, the last that was saved, and no row of the log is there twice."""
    monkeypatch.setattr(progress, "LOG_SECONDS", 0.0)
    config = ThreadedPPOConfig(out=tmp_path, **SMALL, checkpoint_seconds=1e9)
    whole = threaded_ppo.train(replace(config, name="whole"))
    before_update(monkeypatch, 3, kill_one)
    killed = threaded_ppo.train(replace(config, name="killed"), Actors)
    told = "a worker of the training is gone, with its process or its machine: goes on after update 0 with new workers"
    assert told in capsys.readouterr().err.splitlines()
    assert weights(killed) == weights(whole)
    assert [row["steps"] for row in read_rows(killed / "progress.jsonl")] == [96 * n for n in range(1, UPDATES + 1)]


@pytest.mark.nightly
def test_what_a_worker_refuses_is_the_same_sentence(connected_nodes: Any, tmp_path: Path) -> None:
    config = ReinforceConfig(out=tmp_path, **SMALL | {"layouts": ("nowhere.map",), "threads": 1})
    said = []
    for crew in ({}, {"crew": Actors}):
        with pytest.raises(MapError) as error:
            reinforce.train(config, **crew)
        said.append(str(error.value))
    assert said[0] == said[1]


def test_too_few_cores_are_one_sentence(connected_nodes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("train.learning.actors._PATIENCE", 1.0)
    config = ReinforceConfig(out=tmp_path, **SMALL | {"threads": 5, "rows": 40})
    with pytest.raises(LostError, match=r"no core within 1 s for \d of the 5 workers \(--threads\); it has 4 in all"):
        Actors(config, reinforce.actor_loss)


@pytest.mark.nightly
def test_begun_with_threads_and_gone_on_with_actors_of_which_a_machine_is_lost(
    connected_nodes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(_: ThreadedTrainer) -> None:
        raise KeyboardInterrupt

    def lose_machine(trainer: ThreadedTrainer) -> None:
        name = ask(trainer, 0, lambda _: ray.get_runtime_context().get_node_id())
        node = next(node for node in connected_nodes.worker_nodes if node.node_id == name)
        connected_nodes.remove_node(node, allow_graceful=False)
        connected_nodes.add_node(num_cpus=2)

    config = ReinforceConfig(out=tmp_path, **SMALL, checkpoint_seconds=0.0)
    whole = reinforce.train(replace(config, name="whole"))
    before_update(monkeypatch, 2, stop)
    with pytest.raises(KeyboardInterrupt):
        reinforce.train(replace(config, name="parts"))
    before_update(monkeypatch, 4, lose_machine)
    parts = reinforce.train(ReinforceConfig(resume=tmp_path / "parts", progress=False), Actors)
    assert weights(parts) == weights(whole)
