"""A few of the hostile inputs that `make hostile` tries by the million, how it goes on, and what it found."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from agents import make_policy
from tests.hostile.__main__ import attempt, guarded, hunt
from tests.hostile.readers import EVALUATED, PROGRESS, RECORD, SMALL, an_episode
from tests.hostile.targets import TARGETS, Target
from train.evaluation.episodes import EpisodesJob
from train.evaluation.jobs import of_all_runs
from train.evaluation.rollout import make_experiment
from train.learning.curves import read_run
from train.learning.progress import ProgressLog
from train.reporting.comparison import compare, read_runs
from train.reporting.rows import read_rows
from warehouse_env.checked import parse_named
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.movingai import read_map
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator


@pytest.mark.parametrize("name", TARGETS)
def test_a_few_inputs(name: str) -> None:
    with guarded() as folder:
        for number in range(max(4, TARGETS[name].each // 10)):
            assert attempt(name, 0, number, folder) is None


def test_failures_are_counted_by_kind(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    tried: list[float] = []

    def take(given: float, folder: Path) -> None:
        tried.append(given)
        (folder / "left").write_text("by an input")
        assert given < 0.5

    monkeypatch.setitem(TARGETS, "half", Target(lambda rng: rng.random(), take, 10))
    with guarded() as folder:
        failures = hunt(("half",), 3, 17, folder)
        assert not list(folder.iterdir())
    assert len(set(tried)) == 17
    assert failures.total() == sum(given >= 0.5 for given in tried)
    assert '--only "half" --input' in capsys.readouterr().out


def _simulator() -> Simulator:
    simulator = Simulator(EnvConfig(**SMALL))
    simulator.reset(1)
    return simulator


def test_actions_in_the_order_of_another_machine_are_the_same() -> None:
    ours, theirs = _simulator(), _simulator()
    actions = np.array([[3, 16]])
    assert np.array_equal(ours.step(actions), theirs.step(actions.astype(">i8")))


@pytest.mark.parametrize(
    ("field", "value"), [("layout", []), ("robots", "x"), ("seed", None), ("stuck", "a"), ("stuck", 1e300)]
)
def test_rows_of_other_values_are_not_compared(tmp_path: Path, field: str, value: object) -> None:
    for name, rows in (("a", EVALUATED), ("b", [{**EVALUATED[0], field: value}, *EVALUATED[1:]])):
        (tmp_path / f"{name}.jsonl").write_text("\n".join(map(json.dumps, rows)))
    with pytest.raises(WarehouseError, match=f"a {field} is none"):
        compare(read_runs([tmp_path / "a.jsonl", tmp_path / "b.jsonl"]))


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: parse_named(f"{'x' * 5000}:a", "layout", "b"), r"layout x{70,80}.* must be PARAMETER=VALUE"),
        (lambda: _simulator().reset_to(3), "assignments must be 1 of type Assignment"),  # type: ignore[arg-type]
        (lambda: make_policy("~nobody-of-this-name", EnvConfig()), "unknown policy"),
        (lambda: make_policy("~\0", EnvConfig()), "unknown policy"),
        (lambda: GridMap(np.zeros((2, 2)), name="a" * 5000).check_cell((9, 9), "goal"), r"outside map 'a{70,80}"),
        (lambda: make_policy("~\ud800", EnvConfig()), "unknown policy"),
        (lambda: GridMap(np.zeros((2, 2))).check_cell((10**400, 0), "goal"), r"goal \(10{70,80}"),
        (lambda: read_map("a\nb.map"), "is no file name"),
        (lambda: Episode.load("a" * 300), "is no file name"),
        (lambda: Episode.load("a/" * 3000), "is no file name"),
        (lambda: Recorder(_simulator(), (2**70,)), r"below 2\*\*63"),
    ],
)
def test_what_was_found(make: Callable[[], object], sentence: str) -> None:
    """Each ended in another error, or in more than a sentence, once."""
    with pytest.raises(WarehouseError, match=sentence) as raised:
        make()
    assert "\n" not in str(raised.value)


@pytest.mark.filterwarnings("error")
def test_heights_that_signal_are_refused_without_a_warning() -> None:
    heights = np.full((2, 2), 0x7FA00000, np.uint32).view(np.float32)
    with pytest.raises(WarehouseError, match="height at"):
        GridMap(np.zeros((2, 2)), height=heights)


def test_an_archive_that_says_it_is_encrypted_is_one_sentence_and_left_open_by_nobody(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    content = bytearray(an_episode())
    content[content.index(b"PK\1\2") + 8] |= 1  # of the first entry in the directory at the end
    (tmp_path / "e.npz").write_bytes(content)
    with pytest.raises(WarehouseError, match="encrypted"):
        Episode.load(tmp_path / "e.npz")
    assert not recwarn.list


def test_rows_of_a_training_or_an_evaluation_with_odd_values_are_made_again(tmp_path: Path) -> None:
    (tmp_path / "progress.jsonl").write_text('{"steps": 1}\n{"steps": "x"}\n{"steps": [1]}\n')
    ProgressLog(tmp_path, show=False, steps=5).__exit__(None, None, None)
    assert read_rows(tmp_path / "progress.jsonl") == [{"steps": 1}]
    job = EpisodesJob(make_experiment("follow", EnvConfig(**SMALL), 1, 1.0, 1))
    assert job.left([{"seed": [1], "episode": 0}]) == ([], job)
    assert of_all_runs([{"run": {}}, {"run": 0}], 1) == [{"run": 0}]


def test_a_run_whose_record_tells_no_seed_is_drawn_without(tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text(json.dumps({**RECORD, "training": {"config": "x"}}))
    (tmp_path / "progress.jsonl").write_text("\n".join(map(json.dumps, PROGRESS)))
    assert read_run(tmp_path).seed is None
