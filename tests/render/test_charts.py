"""Charts write one complete picture each, and show what they are given."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render import chart_style, charts
from warehouse_env.render.colours import RGB, name_colours
from warehouse_env.render.report_charts import COLLISIONS, Bar, draw_over_robots

image = pytest.importorskip("matplotlib.image")


def colours_of(path: Path) -> set[RGB]:
    pixels = (image.imread(path)[..., :3] * 255).round().astype(int)
    return set(map(tuple, np.unique(pixels.reshape(-1, 3), axis=0).tolist()))


def test_floor_in_metres(grid: GridMap) -> None:
    figure = pytest.importorskip("matplotlib.figure").Figure()
    ax = figure.add_subplot()
    charts.draw_floor(ax, grid)
    assert ax.get_images()[0].get_extent() == [0, 14, 0, 10]
    assert ax.get_images()[0].origin == "upper"


def test_plans_keep_their_planners_colours(tmp_path: Path, grid: GridMap) -> None:
    way = np.array([(9, 0), (8, 1), (8, 2), (8, 3)])
    cells = {"aco": way, "pf_aco": way, "astar": np.zeros((0, 2), dtype=np.int64)}
    charts.paths(grid, cells, "paths", tmp_path / "p.png", {"aco": "3.41 cells"})
    assert set(name_colours(["aco", "pf_aco"]).values()) <= colours_of(tmp_path / "p.png")
    line = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)])
    assert np.allclose(charts._sideways(line, 0.5), [(0, 0.5), (3.5, 0.5), (3.5, 3.0)])
    best = np.array([[np.inf, 30.0, 27.0], [np.inf, np.inf, 28.0]])  # runs without a path at first
    charts.convergence({"aco": best, "none": np.full((2, 3), np.inf)}, 27.0, tmp_path / "c.png")
    assert name_colours(["aco"])["aco"] in colours_of(tmp_path / "c.png")


@pytest.mark.parametrize(
    "figures", [(183.0, 150.0, 220.0), (0.0, 0.0, 0.4), (math.nan,) * 3, (3.0, math.nan, math.nan)]
)
def test_measures_may_be_zero_or_missing(tmp_path: Path, figures: tuple[float, float, float]) -> None:
    bars = [Bar("follow", 16, 2.0, 1.0, 3.0), Bar("ppo", 16, *figures)]
    draw_over_robots({"open": {COLLISIONS: bars, "goals": bars}}, tmp_path / "bars.png")
    assert set(name_colours(["follow"]).values()) <= colours_of(tmp_path / "bars.png")


def test_rounding_errors_of_zero_are_no_collisions() -> None:
    """An interval of zeros may end at 1e-17, which is no decade to begin an axis with."""
    ax = chart_style.empty_figure(4.0, 3.0).subplots()
    chart_style.log_scale(ax, [0.0, 3e-17, math.nan])
    assert (ax.get_yscale(), ax.get_ylim()) == ("linear", (0, 1))
    chart_style.log_scale(ax, [0.0, 0.3, 40.0])
    assert (ax.get_yscale(), ax.get_ylim()[0]) == ("symlog", 0)
