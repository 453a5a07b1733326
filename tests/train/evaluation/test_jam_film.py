"""The film of a jam: every step is kept, the moments are the telling ones, the scene is one that all leave."""

from __future__ import annotations

import numpy as np
import pytest

from train.evaluation import telling
from train.evaluation.jobs import Result
from train.evaluation.rollout import config_of
from train.evaluation.scenes import SCENES, SceneJob
from train.evaluation.telling import Asked, Film, Frame, moments_of, rows_of_film, worst_jam
from warehouse_env.config import EnvConfig

BASE = EnvConfig(planner="astar", tasks="one_shot")


def played() -> Film:
    film = Film(Asked("ppo", config_of("ppo", BASE, {})))
    SceneJob("crossing", "ppo", BASE, 3.0, range(5, 6)).run(lambda done: None, [film])
    return film


def test_every_step_is_kept() -> None:
    film = played()
    assert [frame.seconds for frame in film.frames] == pytest.approx(0.1 * np.arange(31))
    first, last = film.frames[0], film.frames[-1]
    assert first.pose[:, :2] == pytest.approx(SCENES["crossing"]().draw(np.random.default_rng([5, 2])).pose[:, :2])
    assert np.hypot(*(last.pose - first.pose)[:, :2].T).min() > 0.5
    assert (last.speed > 0.3).any()
    assert ((last.chances >= 0) & (last.chances <= 1)).all()
    config = config_of("ppo", BASE, {})
    shown = moments_of(film, config)
    rows = rows_of_film(film)
    assert len(rows) == 4 * 4
    assert [row["stop"] for row in rows] == pytest.approx((1 - shown.chance).ravel().tolist())
    assert (shown.view.left, shown.view.high) < (first.pose[:, 0].min(), first.pose[:, 1].max())


def test_the_telling_moments() -> None:
    film = Film.__new__(Film)
    counts = [0, 1, 2, 3, 4, 4, 4, 3, 2, 1, 1, 0, 0]
    empty = np.zeros((5, 3), np.float32), np.zeros(5, np.float32), np.zeros((5, 4)), np.ones(5, np.bool_)
    film.frames = [Frame(float(t), *empty, np.arange(5) < count) for t, count in enumerate(counts)]
    assert [frame.seconds for frame in film.telling()] == [2.0, 5.0, 8.0, 11.0]


def test_the_worst_jam_is_one_that_dissolves(monkeypatch: pytest.MonkeyPatch) -> None:
    standing = {"a": (3, True), "b": (7, False), "c": (5, True), "d": (4, True)}

    def play(job: SceneJob, tick: object, watch: list[Film]) -> Result:
        watch[0].frames = [Frame(0.0, *(np.zeros(0),) * 4, np.ones(standing[job.scene][0], np.bool_))]
        return Result([{"resolved": standing[job.scene][1]}])

    monkeypatch.setattr(telling, "SCENES", standing)
    monkeypatch.setattr(SceneJob, "run", play)
    ticks: list[int] = []
    found = worst_jam("ppo", BASE, 1.0, 0, lambda: ticks.append(1))
    assert found is not None
    assert (found[0], len(ticks)) == ("c", 4)
    standing.update(a=(1, False), c=(1, False), d=(1, False))
    assert worst_jam("ppo", BASE, 1.0, 0, lambda: None) is None
