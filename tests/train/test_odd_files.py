"""Files that a user hands over, damaged: they are read, or a WarehouseError says in one sentence what is wrong."""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents import WEIGHTS_FOLDER, make_policy, policy_config
from tests.odd import changed, damaged, values, works_or_says
from train.learning import checkpoint
from train.reporting.rows import read_rows, whole_rows
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WarehouseError
from warehouse_env.routes.book import PlanStore
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator

CONFIG = EnvConfig(num_agents=2, planner="astar", layout="open", max_steps=5)
ROWS = b'{"a": 1, "b": [1, 2]}\n{"a": 2}\n'
WEIGHTS = {path.name: path.read_bytes() for path in (WEIGHTS_FOLDER / "ppo").iterdir()}
RECORD = json.loads(WEIGHTS["config.json"])


@cache
def an_episode() -> bytes:
    recorder = Recorder(Simulator(CONFIG), (3,))
    for _ in range(2):
        recorder.step(np.zeros((1, 2), int))
    with tempfile.TemporaryDirectory() as folder:
        recorder.episode.save(Path(folder, "e.npz"))
        return Path(folder, "e.npz").read_bytes()


def replayed(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "e.npz")
        path.write_bytes(content)
        for _ in Episode.load(path).replay():
            pass


@settings(max_examples=60)
@given(st.data())
def test_a_damaged_episode(data: st.DataObject) -> None:
    works_or_says(lambda: replayed(data.draw(damaged(an_episode()))))


@settings(max_examples=60)
@given(st.data())
def test_an_episode_of_other_arrays(data: st.DataObject) -> None:
    with np.load(io.BytesIO(an_episode())) as file:
        arrays = dict(file)
    name = data.draw(st.sampled_from(sorted(arrays)))
    if name == "about":
        text = json.dumps(data.draw(changed(json.loads(arrays[name].tobytes()))))
        arrays[name] = np.frombuffer(text.encode(), dtype=np.uint8)
    else:
        old = arrays[name]
        choices = [np.zeros(0), np.array(5), np.array(["a"]), old[:1], old[..., None], -old.astype(float) - 1]
        choices += [old * np.nan, old.astype(complex), old.astype(np.int64) + 10**6, old.astype(str)]
        arrays[name] = choices[data.draw(st.integers(0, len(choices) - 1))]
    content = io.BytesIO()
    np.savez(content, **arrays)
    works_or_says(lambda: replayed(content.getvalue()))


@settings(max_examples=60)
@given(st.one_of(damaged(WEIGHTS["config.json"]), changed(RECORD).map(lambda data: json.dumps(data).encode())))
def test_a_damaged_record_of_a_policy(config: bytes) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, content in {**WEIGHTS, "config.json": config}.items():
            (folder / file).write_bytes(content)
        works_or_says(lambda: make_policy(folder, policy_config(folder, CONFIG)))


@settings(max_examples=30)
@given(damaged(WEIGHTS["weights.safetensors"]))
def test_damaged_weights(weights: bytes) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, content in {**WEIGHTS, "weights.safetensors": weights}.items():
            (folder / file).write_bytes(content)
        works_or_says(lambda: make_policy(folder, policy_config(folder, CONFIG)))


@given(damaged(ROWS))
def test_damaged_rows(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "rows.jsonl")
        path.write_bytes(content)
        works_or_says(lambda: read_rows(path))
        works_or_says(lambda: whole_rows(path))


@given(st.data())
def test_a_damaged_checkpoint(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        checkpoint.write(folder, {"x": np.zeros(3)}, {"update": 1})
        path = data.draw(st.sampled_from(sorted(folder.iterdir())))
        path.write_bytes(data.draw(damaged(path.read_bytes())))
        works_or_says(lambda: checkpoint.read(folder))


@settings(max_examples=40)
@given(st.data())
def test_a_damaged_store_of_plans_is_not_used(data: st.DataObject) -> None:
    """It neither raises nor gives back what is no list of cells."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = _stored(folder)
        path.write_bytes(data.draw(damaged(path.read_bytes())))
        store = PlanStore(folder)
        for k in range(40):
            cells = works_or_says(lambda k=k: store.get(f"key {k}"))
            assert cells is None or (cells.ndim, cells.shape[1], cells.dtype) == (2, 2, np.int64)
            works_or_says(lambda k=k: store.put(f"new {k}", np.zeros((2, 2), np.int64)))
        works_or_says(store.flush)


def _stored(folder: Path) -> Path:
    store = PlanStore(folder)
    for k in range(40):
        store.put(f"key {k}", np.arange(2 * (k % 7 + 1)).reshape(-1, 2))
    store.flush()
    return next(folder.glob("*.sqlite"))


def test_a_store_whose_table_is_no_text_is_not_used(tmp_path: Path) -> None:
    """SQLite repeats the table's text in its error, and Python could not decode that."""
    path = _stored(tmp_path)
    path.write_bytes(path.read_bytes().replace(b"CREATE TABLE plan", b"CREATE TABL\xff plan"))
    assert PlanStore(tmp_path).get("key 3") is None


@given(values)
def test_any_path(value: Any) -> None:
    works_or_says(lambda: Episode.load(value))


def test_seeds_that_a_file_cannot_hold_are_refused_at_once() -> None:
    with pytest.raises(WarehouseError, match=r"below 2\*\*63"):
        Recorder(Simulator(CONFIG), (2**70,))


def test_a_damaged_episode_leaves_no_file_open(recwarn: pytest.WarningsRecorder) -> None:
    with contextlib.suppress(WarehouseError):
        replayed(an_episode()[:-30])
    assert not recwarn.list
