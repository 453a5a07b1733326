"""A short drive of the one that `make long` makes a million decisions long."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from agents import Actor, make_policy
from tests import long


@pytest.mark.nightly
def test_two_drives_one_of_them_pickled_half_way_come_to_the_same(tmp_path: Path) -> None:
    env = long.config(8, 2, 60)
    long.drive(env, 1, tmp_path / "whole", "whole")
    whole, half = pickle.loads((tmp_path / "whole").read_bytes()), long.Drive(env, 1)
    act = Actor(make_policy(long.POLICY, env), env)
    for k in range(60):
        half = pickle.loads(pickle.dumps(half)) if k == 30 else half
        half.step(act)
    assert whole.digest == half.digest
    assert [part[0] for part in whole.parts] == [str(done) for done in range(6, 61, 6)]
    assert not whole.jammed
