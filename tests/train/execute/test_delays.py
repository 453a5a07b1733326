"""Test the delays of the League of Robot Runners: rates, durations and files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from train.execute.delays import DelayClock, Delays, read_delays
from warehouse_env.errors import ConfigError

ROOM = {
    "minDelay": 10, "maxDelay": 30, "eventModel": "poisson", "pDelay": 0.01, "durationModel": "gaussian",
    "gaussMeanRatio": 0.25, "gaussStdRatio": 0.5, "seed": 3,
}  # fmt: skip


def delayed(delays: Delays, robots: int, ticks: int, seed: int = 0) -> np.ndarray:
    """Return bool[ticks, robots]: which robots are delayed."""
    clock = DelayClock(delays, robots, np.random.default_rng(seed))
    return np.array([clock.held(tick * delays.tick) for tick in range(ticks)])


def lengths(stopped: np.ndarray) -> np.ndarray:
    """Return the durations in ticks of all delays that end in time."""
    edges = np.diff(np.pad(stopped, ((1, 0), (0, 0))).astype(int), axis=0).T
    ends = [np.flatnonzero(own == -1) for own in edges]
    begins = [np.flatnonzero(own == 1) for own in edges]
    return np.concatenate([end - begin[: len(end)] for begin, end in zip(begins, ends, strict=True)])


def test_delay_lasts_its_ticks_and_another_may_follow() -> None:
    assert delayed(Delays(0.5, 1.0, 3, 3), 4, 20).all()
    assert not delayed(Delays(0.5, 0.0), 4, 20).any()


def test_each_tick_is_drawn_once() -> None:
    delays = Delays(0.25, 0.2, 1, 4)
    clock = DelayClock(delays, 50, np.random.default_rng(1))
    drawn = np.array([clock.held(0.05 * k) for k in range(100)])
    np.testing.assert_array_equal(drawn[::5], delayed(delays, 50, 20, 1))
    np.testing.assert_array_equal(drawn, np.repeat(drawn[::5], 5, axis=0))


@pytest.mark.parametrize("events", ["bernoulli", "poisson"])
def test_robots_are_delayed_at_the_rate_given(events: str) -> None:
    stopped = delayed(Delays(1.0, 0.02, 1, 1, events), 200, 5_000)
    assert stopped.mean() == pytest.approx(0.02, rel=0.05)  # 7 standard deviations


def test_durations_keep_their_limits_and_mean() -> None:
    uniform = Delays(1.0, 0.001, 10, 30)
    found = lengths(delayed(uniform, 300, 4_000))
    assert found.min() == 10
    assert found.max() == 30
    assert found.mean() == pytest.approx(20, abs=1)
    near = lengths(delayed(replace(uniform, durations="gaussian", mean=0.25, deviation=0.05), 300, 4_000))
    assert near.mean() == pytest.approx(15, abs=0.3)
    assert near.std() == pytest.approx(1, abs=0.3)


def test_league_problem_defines_its_delays(tmp_path: Path) -> None:
    path = tmp_path / "problem.json"
    path.write_text(json.dumps({"agentCounter": 3, "delayConfig": ROOM}))
    assert read_delays(path, 0.6) == Delays(0.6 / 3, 0.01, 10, 30, "poisson", "gaussian", 0.25, 0.5)
    for data, message in (
        ({}, "no `delayConfig`"),
        ([], "no `delayConfig`"),
        ({"delayConfig": ROOM, "agentCounter": 0}, "no `delayConfig`"),
        ({"delayConfig": ROOM | {"pDelay": 2}}, "probability=2"),
        ({"delayConfig": ROOM | {"maxDelay": 5}}, "longest=5"),
        ({"delayConfig": ROOM | {"eventModel": "weekly"}}, "events='weekly'"),
        ({"delayConfig": ROOM | {"durationModel": 7}}, "durations=7"),
    ):
        path.write_text(json.dumps(data))
        with pytest.raises(ConfigError, match=message):
            read_delays(path, 0.6)
