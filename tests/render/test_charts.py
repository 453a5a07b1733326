"""Test that charts and drawings show all their data in the right colours."""

from __future__ import annotations

import dataclasses
import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render import chart_style, charts
from warehouse_env.render.colours import RGB, name_colours
from warehouse_env.render.heat_maps import Panel, heat_maps
from warehouse_env.render.report_charts import COLLISIONS, Bar, FloorLoad, draw_over_robots, over_robots, throughput

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


def test_plans_use_their_planners_colours(tmp_path: Path, grid: GridMap) -> None:
    way = np.array([(9, 0), (8, 1), (8, 2), (8, 3)])
    cells = {"aco": way, "pf_aco": way, "astar": np.zeros((0, 2), dtype=np.int64)}
    charts.paths(grid, cells, "paths", tmp_path / "p.png", {"aco": "3.41 cells"})
    assert set(name_colours(["aco", "pf_aco"]).values()) <= colours_of(tmp_path / "p.png")
    line = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)])
    assert np.allclose(charts._sideways(line, 0.5), [(0, 0.5), (3.5, 0.5), (3.5, 3.0)])
    best = np.array([[np.inf, 30.0, 27.0], [np.inf, np.inf, 28.0]])  # runs whose first iterations find no path
    charts.convergence({"aco": best, "none": np.full((2, 3), np.inf)}, 27.0, tmp_path / "c.png")
    assert name_colours(["aco"])["aco"] in colours_of(tmp_path / "c.png")


@pytest.mark.parametrize(
    "figures", [(183.0, 150.0, 220.0), (0.0, 0.0, 0.4), (math.nan,) * 3, (3.0, math.nan, math.nan)]
)
def test_charts_accept_zero_and_missing_measures(tmp_path: Path, figures: tuple[float, float, float]) -> None:
    bars = [Bar("follow", 16, 2.0, 1.0, 3.0), Bar("ppo", 16, *figures)]
    draw_over_robots({"open": {COLLISIONS: bars, "goals": bars}}, tmp_path / "bars.png")
    assert set(name_colours(["follow"]).values()) <= colours_of(tmp_path / "bars.png")


def test_rounding_errors_do_not_set_the_axis() -> None:
    """An interval of zeros may end at 1e-17, which must not set the first decade of the axis."""
    ax = chart_style.empty_figure(4.0, 3.0).subplots()
    chart_style.log_scale(ax, [0.0, 3e-17, math.nan])
    assert (ax.get_yscale(), ax.get_ylim()) == ("linear", (0, 1))
    chart_style.log_scale(ax, [0.0, 0.3, 40.0])
    assert (ax.get_yscale(), ax.get_ylim()[0]) == ("symlog", 0)


def read(drawing: str) -> list[str]:
    """Check a drawing and return its texts."""
    root = ElementTree.fromstring(drawing)
    assert root.tag.endswith("svg")
    assert root.get("role") == "img"
    assert "var(--ink)" in drawing
    assert "#2b3038" not in drawing
    assert "#ffffff" not in drawing
    assert root.get("width") is None
    return ["".join(element.itertext()).strip() for element in root.iter() if element.tag.endswith("}text")]


def test_over_robots_names_policies_floors_and_counts() -> None:
    bars = [Bar("ppo", 8, 1.0, 0.5, 1.5), Bar("ppo", 16, 2.0, math.nan, math.nan), Bar("brake", 8, 0.0, 0.0, 0.0)]
    titles = ("collisions per robot-km", "goals per robot-hour")
    floors = {"hall": dict.fromkeys(titles, bars), "yard": dict.fromkeys(titles, bars[:1])}
    texts = read(over_robots(floors, "label <&>"))
    assert {"ppo", "brake", "8", "16", "hall: collisions per robot-km", "yard: goals per robot-hour"} <= set(texts)


def test_drawings_are_reproducible() -> None:
    loads = [FloorLoad(8, 800.0, 700.0, 900.0, False)]
    assert len({throughput(loads, 100.0, loads[0], None, "label") for _ in range(2)}) == 1


def test_throughput_labels_peak_jam_and_knee() -> None:
    loads = [FloorLoad(8, 800.0, 700.0, 900.0, False), FloorLoad(16, 900.0, math.nan, math.nan, True)]
    drawn = read(throughput(loads, 100.0, loads[0], (6.0, 5.0, math.inf), "label"))
    assert {"drives", "jams", "most goals, 8 robots", "a further one adds half, from 6"} <= set(drawn)
    assert "a further one" not in " ".join(read(throughput(loads, 100.0, loads[0], None, "label")))


def test_heat_maps_draw_every_panel(grid: GridMap) -> None:
    heat = np.zeros(grid.shape)
    heat[0, 0] = 3.0
    opened = grid.occupied.copy()
    panels = [
        Panel("waits", grid, heat, np.array([[1.0, 2.0]]), [(3.0, 4.0), (5.0, 6.0)]),
        Panel("opened", grid, opened=opened),
        Panel("ways", dataclasses.replace(grid, one_way=np.where(grid.occupied, 0, 1).astype(np.uint8)), heat),
        Panel("cold", grid, np.zeros(grid.shape)),
    ]
    drawing = heat_maps(panels, "seconds", "label")
    assert {"waits", "opened", "ways", "cold", "1", "2", "seconds"} <= set(read(drawing))
    assert drawing.count("<image") >= 6  # four floors and two heat maps
    assert read(heat_maps(panels[3:], "seconds", "label"))
