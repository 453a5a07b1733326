"""Drawings for pages: SVG in the page's inks, with what they are given in them."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.heat_maps import Panel, heat_maps
from warehouse_env.render.report_charts import Bar, FloorLoad, Pair, differences, over_robots, throughput

pytest.importorskip("matplotlib")


def read(drawing: str) -> list[str]:
    """Check a drawing, and return its texts."""
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


def test_drawings_are_the_same_every_time() -> None:
    pairs = [Pair("a", 1.0, 0.5, 1.5), Pair("b", 0.1, -1.0, 1.2), Pair("c", 1.0, math.nan, math.nan)]
    drawings = [differences(pairs, "label", "goals") for _ in range(2)]
    assert drawings[0] == drawings[1]
    assert {"a", "b", "c", "goals"} <= set(read(drawings[0]))


def test_throughput() -> None:
    loads = [FloorLoad(8, 800.0, 700.0, 900.0, False), FloorLoad(16, 900.0, math.nan, math.nan, True)]
    drawn = read(throughput(loads, 100.0, loads[0], (6.0, 5.0, math.inf), "label"))
    assert {"drives", "jams", "most goals, 8 robots", "a further one adds half, from 6"} <= set(drawn)
    assert "a further one" not in " ".join(read(throughput(loads, 100.0, loads[0], None, "label")))


def test_heat_maps_draw_every_panel(grid: GridMap) -> None:
    heat = np.zeros(grid.shape)
    heat[0, 0] = 3.0
    opened, ways = grid.occupied.copy(), np.where(grid.occupied, 0, 1).astype(np.uint8)
    panels = [
        Panel("waits", grid, heat, np.array([[1.0, 2.0]]), [(3.0, 4.0), (5.0, 6.0)]),
        Panel("opened", grid, opened=opened),
        Panel("ways", grid, heat, one_way=ways),
        Panel("cold", grid, np.zeros(grid.shape)),
    ]
    drawing = heat_maps(panels, "seconds", "label")
    assert {"waits", "opened", "ways", "cold", "1", "2", "seconds"} <= set(read(drawing))
    assert drawing.count("<image") >= 6  # shelves of each, and two heats
    assert read(heat_maps(panels[3:], "seconds", "label"))
