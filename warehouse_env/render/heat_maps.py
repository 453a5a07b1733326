"""Heat maps of a floor for pages: where robots wait, touch and pass, and what is proposed there; a hall's map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.hall import Hall
from warehouse_env.maps.halls.map_server import UNKNOWN
from warehouse_env.render.chart_style import draw_arrows, draw_discs, empty_figure, hexed, set_metres, style, svg
from warehouse_env.render.colours import BLUE, CONTACT, GREEN, INDIGO, ORANGE, PURPLE, RGB, VERMILION
from warehouse_env.render.extras import load

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_WIDE = 10.0  # [inches] of a picture
_SHELF: RGB = (140, 148, 158)
_HEAT = ((1.0, 0.86, 0.3, 0.0), (0.99, 0.70, 0.12, 0.75), (0.90, 0.36, 0.05, 0.95), (0.62, 0.05, 0.12, 1.0))
_WHITE = "#fffffe"  # stays white: `svg` replaces "#ffffff" by the page's paper
_POWER = 0.5  # of the scale: a quarter of the maximum has half of its colour


class Panel(NamedTuple):
    """A floor and what is drawn on it.

    heat: float[H, W], no colour where it is 0. marks: float[K, 2] [m], crosses. numbers: places (x, y) [m], numbered
    from 1. opened: bool[H, W], cells whose shelf is removed.
    """

    title: str
    grid: GridMap
    heat: NDArray[np.floating[Any]] | None = None
    marks: NDArray[np.floating[Any]] | None = None
    numbers: Sequence[tuple[float, float]] = ()
    opened: NDArray[np.bool_] | None = None


def heat_maps(panels: Sequence[Panel], unit: str, label: str, shared: bool = True) -> str:
    """Draw panels as SVG, up to three in a row, with one colour bar in `unit` if `shared`, else one each."""
    with style():
        across = 2 if len(panels) == 4 else min(3, len(panels))
        rows = -(-len(panels) // across)
        ratio = max(panel.grid.shape[0] / panel.grid.shape[1] for panel in panels)
        wide = _WIDE if across > 1 else 0.7 * _WIDE
        figure = empty_figure(wide, rows * (min(1.6, ratio) * wide / across * 0.93 + 0.4) + 0.1)
        axes = figure.subplots(rows, across, squeeze=False)
        most = [0.0 if panel.heat is None else float(panel.heat.max()) for panel in panels]
        drawn = []
        for ax, panel, own in zip(axes.flat, panels, most, strict=False):
            image = _draw(ax, panel, max(most) if shared else own)
            if image is not None:
                drawn.append((ax, image))
        for ax in axes.flat[len(panels) :]:
            ax.set_axis_off()
        bars = [(axes.ravel().tolist(), drawn[0][1])] if shared and drawn else drawn
        for where, image in bars:
            bar = figure.colorbar(image, ax=where, fraction=0.03, pad=0.015, aspect=30, shrink=0.9)
            bar.set_label(unit)
            bar.outline.set_visible(False)
        return svg(figure, label)


def _draw(ax: Axes, panel: Panel, most: float) -> Any:
    """Draw a floor into axes; return the image of its colour bar, None without heat."""
    grid, (rows, columns) = panel.grid, panel.grid.shape
    side = grid.cell_size
    place: dict[str, Any] = {"extent": (0, columns * side, 0, rows * side), "interpolation": "none"}
    ax.imshow(_shelves(panel), **place)
    draw_discs(ax, grid, _SHELF, 0.6)
    image = None
    if panel.heat is not None and most > 0:
        colours = load("matplotlib.colors")
        scale = colours.LinearSegmentedColormap.from_list("heat", _HEAT)  # from clear over yellow to dark red
        norm = colours.PowerNorm(_POWER, 0, most)
        image = ax.imshow(np.where(panel.heat > 0, panel.heat, 0.0), cmap=scale, norm=norm, **place)
    x, y = grid.centre(grid.stations).T
    ax.plot(x, y, "s", ms=max(1.2, 110 / max(rows, columns)), mfc="none", mec=hexed(BLUE), mew=0.7, alpha=0.8)
    draw_arrows(ax, grid, grid.one_way, GREEN)
    if panel.marks is not None and len(panel.marks):
        ax.plot(*panel.marks.T[:2], "x", ms=4.5, mew=1.3, color=hexed(CONTACT), alpha=0.7)
    for number, (at_x, at_y) in enumerate(panel.numbers, start=1):
        circle = {"boxstyle": "circle,pad=0.22", "fc": hexed(BLUE), "ec": _WHITE, "lw": 1.0}
        ax.annotate(
            str(number), (at_x, at_y), xytext=(9, 9), textcoords="offset points", ha="center", va="center",
            color=_WHITE, fontsize=8, fontweight="bold", bbox=circle,
            arrowprops={"arrowstyle": "-", "color": hexed(BLUE), "lw": 1.2}, zorder=6,
        )  # fmt: skip
    ax.set_title(panel.title)
    ax.tick_params(labelsize=8)
    set_metres(ax, grid)
    return image


def _shelves(panel: Panel) -> NDArray[np.float64]:
    """Return float64[H, W, 4]: shelves in grey, opened cells in green, the rest clear."""
    image = np.zeros((*panel.grid.shape, 4))
    image[panel.grid.walls] = (*(part / 255 for part in _SHELF), 0.6)
    if panel.opened is not None:
        image[panel.opened] = (*(part / 255 for part in GREEN), 0.9)
    return image


_HALL_WIDE = 8.5  # [inches] of a picture, or as high
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
    left, _, low, _ = _extent(hall)
    side, height = hall.occupancy.resolution, hall.occupancy.values.shape[0]
    cells = hall.grid.cell(np.column_stack([left + (columns + 0.5) * side, low + (height - rows - 0.5) * side]))
    return hall.grid.marked(cells[hall.raster.inside(cells)])


def hall_map(hall: Hall, label: str) -> str:
    """Draw a hall as SVG: its pixels, the kinds of cells, one-way arrows, pick faces and stations."""
    grid, kinds = hall.grid, cell_kinds(hall)
    sides = grid.shape[1] * grid.cell_size, grid.shape[0] * grid.cell_size
    ratio = sides[1] / sides[0]
    with style():
        size = (_HALL_WIDE, _HALL_WIDE * ratio + 0.9) if ratio < 1 else (_HALL_WIDE / ratio + 1.0, _HALL_WIDE + 0.9)
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
        frame = "floor" if grid.yaw else "map"
        ax.set(xlabel=f"x [m] of the {frame}", ylabel=f"y [m] of the {frame}")
        patch = load("matplotlib.patches").Patch
        shown = [one for number, one in enumerate(_KINDS.items()) if (kinds == number).any()]
        keys = [patch(fc=hexed(colour), alpha=alpha, label=name) for name, (colour, alpha) in shown]
        handles = [patch(fc=hexed(_STANDS), label="stands there, by the map"), *keys, *ax.lines]
        if (hall.occupancy.values == UNKNOWN).any():
            handles.insert(1, patch(fc=hexed(_STANDS), alpha=0.25, label="unknown to the map"))
        figure.legend(handles=handles, loc="outside lower center", ncols=3 if size[0] > 6 else 2, fontsize=8.5)
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
    (x, y), (left, low) = hall.occupancy.origin, hall.raster.origin
    rows, columns = (side * hall.occupancy.resolution for side in hall.occupancy.values.shape)
    return x - left, x - left + columns, y - low, y - low + rows
