"""A hall's map overlaid with its floor of cells, for pages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.halls.hall import Hall
from warehouse_env.maps.halls.map_server import UNKNOWN
from warehouse_env.render.chart_style import FAINT, draw_arrows, empty_figure, hexed, set_metres, style, svg
from warehouse_env.render.colours import BLUE, CONTACT, GREEN, INDIGO, ORANGE, PURPLE, RGB, VERMILION
from warehouse_env.render.extras import load

_WIDE = 8.5  # [inches] of a picture, or as high
_MOST_PIXELS = 1200  # of the map's longer side in it
_STANDS: RGB = (70, 77, 88)
_KINDS: Mapping[str, tuple[RGB, float]] = {
    "driven on": (GREEN, 0.20),
    "driven on, though something small stands there": (VERMILION, 0.50),
    "closed by a mask or off the lanes": (INDIGO, 0.30),
    "cut off": (CONTACT, 0.45),
    "floor that is no whole free cell": (ORANGE, 0.35),
    "too narrow for these robots": (PURPLE, 0.35),
}
"""Kind of a cell, in the order of the legend -> its colour and opacity."""

SMALL, NARROW = 1, 5  # indices of floor with a small obstacle, and of tight floor
_OCCUPIED = 100  # [%], of a pixel


def cell_kinds(hall: Hall) -> NDArray[np.int64]:
    """Return int64[H, W]: the index of each cell's kind in the legend, -1 for none."""
    grid = hall.grid
    region = largest_region(~grid.occupied)
    driven = np.where(_holds(hall, hall.occupancy.values == _OCCUPIED), SMALL, 0)
    driven = np.where(grid.closed, NARROW, driven)
    found = np.where(region, driven, np.where(hall.barred, 2, np.where(~grid.occupied, 3, 4)))
    return np.where((found == 4) & ~_holds(hall, hall.occupancy.values == 0), -1, found)


def _holds(hall: Hall, pixels: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return bool[H, W]: cells that contain the middle of a marked pixel bool[h, w]."""
    rows, columns = np.nonzero(pixels)
    x, y = hall.occupancy.origin
    side, height = hall.occupancy.resolution, hall.occupancy.values.shape[0]
    points = np.column_stack([x + (columns + 0.5) * side, y + (height - rows - 0.5) * side])
    cells = hall.raster.cells(points)
    found = np.zeros(hall.grid.shape, dtype=np.bool_)
    found[tuple(cells[hall.raster.inside(cells)].T)] = True
    return found


def hall_map(hall: Hall, label: str) -> str:
    """Draw a hall as SVG: its pixels, the kinds of cells, one-way arrows, pick faces and stations."""
    grid, kinds = hall.grid, cell_kinds(hall)
    sides = grid.shape[1] * grid.cell_size, grid.shape[0] * grid.cell_size
    ratio = sides[1] / sides[0]
    with style():
        size = (_WIDE, _WIDE * ratio + 0.9) if ratio < 1 else (_WIDE / ratio + 1.0, _WIDE + 0.9)
        figure = empty_figure(*size)
        ax = figure.add_subplot()
        cover = np.zeros((*grid.shape, 4))
        for number, (colour, alpha) in enumerate(_KINDS.values()):
            cover[kinds == number] = (*(part / 255 for part in colour), alpha)
        ax.imshow(cover, extent=(0, sides[0], 0, sides[1]), interpolation="none")
        ax.imshow(_pixels(hall), extent=_extent(hall), interpolation="none")
        draw_arrows(ax, grid, grid.one_way, BLUE)
        mark = max(1.5, 130 / max(grid.shape))
        inks: dict[str, Any] = {"ls": "none", "mew": 1.2}
        ax.plot(*grid.centre(grid.picks).T, "o", ms=0.6 * mark, c=hexed(INDIGO), label="pick face", **inks)
        ax.plot(*grid.centre(grid.stations).T, "s", ms=1.2 * mark, mec=hexed(BLUE), mfc="none", label="station", **inks)
        set_metres(ax, grid)
        ax.set(xlabel="x [m] of the map", ylabel="y [m] of the map")
        patch = load("matplotlib.patches").Patch
        shown = [one for number, one in enumerate(_KINDS.items()) if (kinds == number).any()]
        keys = [patch(fc=hexed(colour), alpha=alpha, label=name) for name, (colour, alpha) in shown]
        handles = [patch(fc=hexed(_STANDS), label="stands there, by the map"), *keys, *ax.lines]
        if (hall.occupancy.values == UNKNOWN).any():
            handles.insert(1, patch(fc=hexed(_STANDS), alpha=0.25, label="unknown to the map"))
        figure.legend(handles=handles, loc="outside lower center", ncols=3 if size[0] > 6 else 2, fontsize=8.5)
        for edge in ax.spines.values():
            edge.set(visible=True, color=FAINT)
        return svg(figure, label)


def _pixels(hall: Hall) -> NDArray[np.float64]:
    """Return float64[h, w, 4]: the map, thinned if it has very many pixels; free floor is transparent."""
    values = hall.occupancy.values
    every = -(-max(values.shape) // _MOST_PIXELS)
    rows, columns = (side // every for side in values.shape)
    blocks = values[: rows * every, : columns * every].reshape(rows, every, columns, every)
    most = blocks.max(axis=(1, 3))  # what stands is not thinned away
    image = np.zeros((*most.shape, 4))
    image[..., :3] = np.array(_STANDS) / 255
    image[..., 3] = np.where(most > 0, most / 100, np.where((blocks == UNKNOWN).any(axis=(1, 3)), 0.25, 0.0))
    return image


def _extent(hall: Hall) -> tuple[float, float, float, float]:
    """Return the map's extent in the floor's own metres: left, right, bottom, top."""
    (x, y), (left, low) = hall.occupancy.origin, hall.grid.origin
    rows, columns = (side * hall.occupancy.resolution for side in hall.occupancy.values.shape)
    return x - left, x - left + columns, y - low, y - low + rows
