"""Films of policies: what is seen, for how long, and clear errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from train.evaluation import films
from train.evaluation.films import film
from train.evaluation.rollout import make_experiment, run
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError

image = pytest.importorskip("PIL.Image")
pytest.importorskip("pygame")
pytest.importorskip("imageio_ffmpeg")

SMALL: dict[str, Any] = {"layout": "open", "num_agents": 3, "planner": "astar"}


def frames(path: Path) -> list[np.ndarray[Any, Any]]:
    with image.open(path) as film:
        return [np.array((film.seek(k), film.convert("RGB"))[1]) for k in range(film.n_frames)]


def test_a_frame_a_tenth_of_a_second_of_the_film(tmp_path: Path) -> None:
    film(tmp_path / "a.gif", "follow", seconds=4.0, speed=2.0, pixels=100, **SMALL)
    film(tmp_path / "b.gif", "follow", begin=2.0, seconds=2.0, speed=2.0, pixels=100, **SMALL)
    long, late = frames(tmp_path / "a.gif"), frames(tmp_path / "b.gif")
    assert (len(long), len(late)) == (21, 11)
    assert max(long[0].shape[:2]) <= 128 + 1  # with the caption
    assert np.abs(long[-1].astype(int) - late[-1]).mean() < 2  # the same moment, but for the palette


@pytest.mark.parametrize("policy", ["ppo", "central_pibt"])
def test_robots_drive_as_in_an_evaluation(policy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    filmed, poses = list[Any](), list[Any]()
    draw = films.draw
    monkeypatch.setattr(films, "draw", lambda scene, scale: (filmed.append(scene.pose.copy()), draw(scene, scale))[1])
    options: dict[str, Any] = {"layout": "narrow", "num_agents": 12, "planner": "astar"}
    film(tmp_path / "a.gif", policy, seed=3, begin=20.0, seconds=0.0, pixels=100, **options)
    experiment = make_experiment(policy, EnvConfig(**options), 1, 20.0, 3)
    run(experiment, [lambda simulator, steps: poses.append(simulator.state.pose[0].copy())])
    np.testing.assert_array_equal(filmed[0], poses[-1])


@pytest.mark.parametrize(
    ("policies", "options", "said"),
    [((), {}, "at least one policy"), (("folow",), {}, "follow")],
)
def test_wrong_names_are_refused(policies: tuple[str, ...], options: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=said):
        film(tmp_path / "none.gif", *policies, **options)
    assert not list(tmp_path.iterdir())
