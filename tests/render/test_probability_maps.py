"""Chances lie where they belong on the floor, robots point where they head."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from warehouse_env.config import RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.learning_curves import PANELS, Curve
from warehouse_env.render.overview import overview
from warehouse_env.render.probability_maps import (
    Moments,
    ProbabilityMap,
    View,
    draw_chances,
    draw_robot,
    moments,
    probability_maps,
)

figures = pytest.importorskip("matplotlib.figure")
VIEW = View(0.0, 10.0, 4.0, 8.0)


@pytest.fixture
def heat(grid: GridMap) -> ProbabilityMap:
    x, y = VIEW.points(2.0, 1.0)
    chance = np.linspace(0, 1, 20).reshape(4, 5)
    chance[0, 0] = np.nan
    route = np.array([(0.0, 5.0), (10.0, 5.0)])
    pose, speed = np.array([(5.0, 5.5, math.pi)]), np.array([1.0])
    chances = {"stop": chance, "go": 1 - chance}
    return ProbabilityMap(grid, RobotSpec(), x, y, np.zeros((4, 5)), chances, pose, speed, route, VIEW)


@pytest.fixture
def jam(grid: GridMap) -> Moments:
    pose = np.array([[(2.0, 5.0, 0.0), (6.0, 5.0, 1.0)]] * 4)
    chance, alive = np.array([[0.0, 1.0]] * 4), np.array([[True, False]] * 4)
    return Moments(grid, RobotSpec(), np.arange(4.0), pose, np.ones((4, 2)), chance, alive, VIEW)


def test_a_lattice_fills_its_view() -> None:
    x, y = View(1.0, 2.0, 3.0, 3.4).points(0.25, 0.1)
    assert x == pytest.approx([1.125, 1.375, 1.625, 1.875])
    assert y == pytest.approx([3.05, 3.15, 3.25, 3.35])


def test_chances_lie_where_they_were_asked(heat: ProbabilityMap) -> None:
    axes = figures.Figure().subplots(1, 2)
    draw_chances(axes, heat)
    for ax, (name, chance) in zip(axes, heat.chances.items(), strict=True):
        floor, image = ax.get_images()
        assert ax.get_title(loc="left") + ax.get_title() == name
        assert floor.get_extent() == [0, 14, 0, 10]
        assert image.get_extent() == pytest.approx([0.0, 10.0, 4.0, 8.0])
        assert image.origin == "lower"  # row 0 is the southern one
        assert image.get_clim() == (0, 1)
        shown = image.get_array()
        assert shown.mask.sum() == 1
        assert shown.mask[0, 0]
        assert np.array_equal(shown.data[1:], chance[1:])
        assert (ax.get_xlim(), ax.get_ylim()) == ((0, 10), (4, 8))


def test_robots_point_where_they_head() -> None:
    for speed, tip in ((1.2, 3.15 + 1.2), (-0.4, 3.0 - 0.75 - 0.4)):
        ax = figures.Figure().subplots()
        draw_robot(ax, np.array([2.0, 3.0, math.pi / 2]), speed, RobotSpec(), "red")
        body, nose = (patch.get_xy() for patch in ax.patches)
        assert (body.min(axis=0), body.max(axis=0)) == (
            pytest.approx([1.7, 3.0 - 0.75]), pytest.approx([2.3, 3.0 + 0.15]),
        )  # fmt: skip
        assert nose[np.argmax(nose[:, 1])] == pytest.approx([2.0, 3.11])
        (arrow,) = ax.texts
        assert arrow.xy == pytest.approx((2.0, tip))
    ax = figures.Figure().subplots()
    draw_robot(ax, np.array([2.0, 3.0, 0.0]), 0.0, RobotSpec(), "red")
    assert not ax.texts


def test_all_pictures_are_drawn(heat: ProbabilityMap, jam: Moments, tmp_path: Path) -> None:
    run = Curve("ppo", np.array([1.0, 2.0]), {key: np.array([1.0, 2.0]) for key, _, _ in PANELS})
    probability_maps(heat, "heat", tmp_path / "a.png")
    moments(jam, "jam", tmp_path / "b.png")
    for number, curves in enumerate(([], [run])):
        overview({"heat": heat}, {"jam": jam}, curves, "all", tmp_path / f"c{number}.png")
    image = pytest.importorskip("matplotlib.image")
    shapes = [image.imread(path).shape for path in sorted(tmp_path.iterdir())]
    assert len(shapes) == 4
    assert shapes[3][0] > shapes[2][0] + 150  # the curves
