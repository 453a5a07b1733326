"""A floor with its pick faces and stations, numbered as the file of places beside a map numbers them."""

from __future__ import annotations

import os

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.chart_style import INK, save, style
from warehouse_env.render.charts import floor_figure

_LEGIBLE = 1500  # numbers; more of them are a grey patch


def draw_places(grid: GridMap, path: str | os.PathLike[str]) -> None:
    """Write a picture of a floor with the numbers of its places: picks upright, stations in a box."""
    with style():
        figure, ax = floor_figure(grid, f"{grid.name}: {len(grid.picks)} picks, {len(grid.stations)} stations")
        size = max(2.5, min(8.0, 260.0 * min(1.0, 40 / max(grid.shape)) / 40))
        for cells, box in (
            (grid.picks, None),
            (grid.stations, {"boxstyle": "round,pad=0.15", "fc": "white", "lw": 0.5}),
        ):
            if len(cells) <= _LEGIBLE:
                for number, (x, y) in enumerate(grid.centre(cells).tolist(), start=1):
                    ax.text(x, y, str(number), size=size, color=INK, ha="center", va="center", bbox=box, zorder=5)
        save(figure, path)
