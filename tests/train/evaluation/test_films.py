"""Films of policies and of colonies: what is seen, for how long, and clear errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from train.evaluation.films import _iterations, film, film_of_ants
from warehouse_env import make_layout, make_planner
from warehouse_env.errors import ConfigError, PlanError

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


def test_policies_stand_side_by_side(tmp_path: Path) -> None:
    film(tmp_path / "one.gif", "follow", seconds=0.4, pixels=100, **SMALL)
    film(tmp_path / "two.gif", "follow", "greedy", seconds=0.4, pixels=100, **SMALL)
    one, two = frames(tmp_path / "one.gif")[0], frames(tmp_path / "two.gif")[0]
    assert two.shape == (one.shape[0], 2 * one.shape[1], 3)


def test_a_scene_is_played_on_its_own_floor(tmp_path: Path) -> None:
    film(tmp_path / "scene.gif", "follow", scene="head_on_two_cells", seconds=1.0, pixels=280, planner="astar")
    height, width, _ = frames(tmp_path / "scene.gif")[0].shape
    assert (width, height) == (280, 70 + 28)  # 28 x 7 cells of 10 px, and the caption


@pytest.mark.parametrize(
    ("policies", "options", "said"),
    [((), {}, "at least one policy"), (("folow",), {}, "follow"), (("follow",), {"scene": "crosing"}, "crossing")],
)
def test_wrong_names_are_refused(policies: tuple[str, ...], options: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=said):
        film(tmp_path / "none.gif", *policies, **options)
    assert not list(tmp_path.iterdir())


def test_a_colony_is_watched_and_not_changed() -> None:
    grid, start, goal = make_layout("open"), (2, 2), (15, 15)
    ants: Any = make_planner("pf_aco:iterations=6,ants=10,local_search=false,patience=null")
    known = _iterations(ants, grid, start, goal, seed=3)
    _, found = ants.search(grid, start, goal, np.random.default_rng(3))
    assert len(known) == 6
    np.testing.assert_array_equal(known[-1][0].ravel(), found.pheromone.sum(axis=1))
    np.testing.assert_array_equal(known[-1][1], ants.plan(grid, start, goal, np.random.default_rng(3)).cells)


def test_a_film_of_ants_shows_each_iteration_and_the_last_for_a_second(tmp_path: Path) -> None:
    grid = make_layout("open")
    film_of_ants(tmp_path / "ants.gif", "acs:iterations=4,ants=10", grid, (2, 2), (15, 15), pixels=100)
    shown = frames(tmp_path / "ants.gif")
    assert len(shown) >= 5  # a .gif holds a still frame once, for longer
    with pytest.raises(ConfigError, match="no ant system"):
        film_of_ants(tmp_path / "none.gif", "astar", grid, (2, 2), (15, 15))
    with pytest.raises(PlanError):
        film_of_ants(tmp_path / "none.gif", "acs", grid, (2, 2), (999, 15))
