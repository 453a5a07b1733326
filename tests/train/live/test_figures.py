"""Samples of a world, held against what they must be by hand; and queues of pages that are slow."""

from __future__ import annotations

import numpy as np
import pytest

from train.live import listeners
from train.live.figures import WINDOW, LiveFigures, Sample
from train.live.listeners import Listener


def moment(goals: int, contacts: int = 0, waits: tuple[int, ...] = (-1, -1), speed: tuple[float, ...] = (1.0, 1.0)):  # type: ignore[no-untyped-def]
    return {
        "flags": np.ones(2, np.uint16), "waits_for": np.array(waits), "speed": np.array(speed, np.float32),
        "totals": np.array([goals, contacts, 0]),
    }  # fmt: skip


def test_a_sample_a_second_with_means_of_its_steps() -> None:
    figures = LiveFigures()
    assert figures.add(0.5, moment(0, waits=(1, -1), speed=(0.0, 1.0))) is None
    sample = figures.add(1.0, moment(1, contacts=3, speed=(0.0, 0.0)))
    assert sample == Sample(1.0, pytest.approx(1 / 2 / 1.0 * 3600), 0.25, 0.75, 3)
    assert figures.add(1.5, moment(1)) is None
    assert figures.add(2.0, moment(1)) == Sample(2.0, pytest.approx(900.0), 0.0, 0.0, 0)


def test_goals_an_hour_are_those_of_the_last_two_minutes() -> None:
    figures = LiveFigures()
    for second in range(1, 301):
        figures.add(float(second), moment(goals=min(second, 100)))
    assert figures.samples[99].goals_per_robot_hour == pytest.approx(1800.0)
    assert figures.samples[159].goals_per_robot_hour == pytest.approx((100 - 40) / 2 / WINDOW * 3600)
    assert figures.samples[-1].goals_per_robot_hour == 0.0


def test_parked_robots_neither_wait_nor_stand() -> None:
    one = moment(0, waits=(1, -1), speed=(0.0, 0.0)) | {"flags": np.array([1, 0], np.uint16)}
    sample = LiveFigures().add(1.0, one)
    assert sample is not None
    assert (sample.waiting, sample.standing) == (1.0, 1.0)


def test_a_slow_page_begins_again_with_a_whole_world(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listeners, "MOST_WAITING", 2)
    listener = Listener()
    listener.put(b"lost")
    listener.put(b"world", world=True)
    listener.put(b"more")
    assert not listener.needs_world
    assert listener.take(0.0) == b"worldmore"
    for _ in range(3):
        listener.put(b"more")
    assert listener.needs_world
    assert listener.take(0.0) == b""
    listener.put(b"a whole world", world=True)
    assert listener.take(0.0) == b"a whole world"
