"""A short drive of the one that `make long` makes a million decisions long."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from tests import long


@pytest.mark.nightly
def test_two_drives_one_of_them_pickled_half_way_come_to_the_same(tmp_path: Path) -> None:
    env = long.config(8, 2, 60)
    for name in ("whole", "parted"):
        long.drive(env, 1, tmp_path / name, name)
    whole, other = (pickle.loads((tmp_path / name).read_bytes()) for name in ("whole", "parted"))
    half = long.Drive(env, 1)
    act = long.make_actor(long.POLICY, env)
    for k in range(60):
        half = pickle.loads(pickle.dumps(half)) if k == 30 else half
        assert not half.step(act)
    assert whole.digest == other.digest == half.digest
    assert [part.decisions for part in whole.parts] == list(range(6, 61, 6))
    assert len(long.part_table(whole.parts).cells) == long.PARTS


@pytest.mark.nightly
def test_who_stands_is_recorded(tmp_path: Path) -> None:
    long.drive(long.config(8, 2, 40), 1, tmp_path / "run", "short", patience=1.0)
    page = next(tmp_path.glob("run-*.html"))
    *_, last = long.driven_on(page.with_suffix(".pickle").read_bytes(), int(page.stem.split("-")[-1]))
    assert last.simulator.robots["clocks"]["standing_time"].max() > 1.0
