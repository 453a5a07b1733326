"""A picture of a floor with its pick faces and stations, numbered as in the file of places beside the map."""

from __future__ import annotations

import os
from collections.abc import Sequence

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.chart_style import INK, save, style
from warehouse_env.render.charts import floor_figure

_LEGIBLE = 1500  # names; more would be a grey patch
_LONGEST = 12  # characters of a name


def draw_places(grid: GridMap, picks: Sequence[str], stations: Sequence[str], path: str | os.PathLike[str]) -> None:
    """Write a picture of a floor with the names of its picks and stations, these in boxes."""
    with style():
        figure, ax = floor_figure(grid, f"{grid.name}: {len(grid.picks)} picks, {len(grid.stations)} stations")
        size = max(2.5, min(6.5, 260.0 / max(grid.shape)))
        boxed = {"boxstyle": "round,pad=0.15", "fc": "white", "lw": 0.5}
        for cells, names, box in ((grid.picks, picks, None), (grid.stations, stations, boxed)):
            if len(cells) > _LEGIBLE:
                continue
            for name, (x, y) in zip(names, grid.centre(cells).tolist(), strict=True):
                text = name[:_LONGEST].replace("$", r"\$")
                ax.text(x, y, text, size=size, color=INK, ha="center", va="center", bbox=box, zorder=5)
        save(figure, path)
