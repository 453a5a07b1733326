"""Pictures of floors, of planned paths, and of convergence. Each planner keeps its colour in all of them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import counted
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.chart_style import INK, draw_arrows, empty_figure, hexed, save, set_metres, style
from warehouse_env.render.colours import SKY, name_colours
from warehouse_env.render.floor import floor_image, scale_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FLOOR_PIXELS = 1400  # of the floor's longer side in a chart
_LEGIBLE = 1500  # names of places; more would be a grey patch
_LONGEST = 12  # characters of a name of a place


def draw_floor(ax: Axes, grid: GridMap) -> None:
    """Draw a floor into axes, in metres, equal in both directions, with arrows where cells are one way."""
    width, height = grid.shape[1] * grid.cell_size, grid.shape[0] * grid.cell_size
    image = floor_image(grid, scale_for(grid, _FLOOR_PIXELS, most=24.0))
    ax.imshow(image, extent=(0, width, 0, height), interpolation="antialiased")
    ax.set(xlabel="x [m]", ylabel="y [m]")
    set_metres(ax, grid)
    draw_arrows(ax, grid, grid.one_way, SKY)


def paths(
    grid: GridMap, cells: Mapping[str, NDArray[np.number[Any]]], title: str, path: str | os.PathLike[str],
    notes: Mapping[str, str] | None = None,
) -> None:  # fmt: skip
    """Write a picture of planned paths: for each planner int[L, 2] cells (row, col), or the float[K, 2] of a line.

    notes: text beside a planner's name in the legend, such as length and turns.
    """
    with style():
        figure, ax = floor_figure(grid, title)
        colours = name_colours(cells)
        shown = {name: np.asarray(way) for name, way in cells.items() if len(way)}
        for k, (name, way) in enumerate(shown.items()):
            # Lines lie side by side, so that shared stretches show every planner.
            shift = (k - (len(shown) - 1) / 2) * min(0.16, 0.6 / len(shown)) * grid.cell_size
            line = _sideways(grid.centre(way), shift)
            label = f"{name}: {notes[name]}" if notes and name in notes else name
            ax.plot(line[:, 0], line[:, 1], color=hexed(colours[name]), lw=2, label=label, solid_joinstyle="round")
        for way in list(shown.values())[:1]:
            for (x, y), marker, what in zip(grid.centre(way[[0, -1]]), "os", ("start", "goal"), strict=True):
                ax.plot(x, y, marker, ms=8, mfc="white", mec=INK, mew=1.6, zorder=5)
                ax.annotate(
                    what, (x, y), xytext=(9, -3), textcoords="offset points", color=INK, fontsize=9, zorder=6,
                    bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.8},
                )  # fmt: skip
        for name in [name for name in cells if name not in shown]:
            ax.plot([], [], color=hexed(colours[name]), lw=2, ls=":", label=f"{name}: no path")
        if cells:
            figure.legend(loc="outside lower center", ncols=1 if len(cells) < 3 else 2)
        save(figure, path)


def convergence(
    best: Mapping[str, NDArray[np.floating[Any]]], optimum: float, path: str | os.PathLike[str],
    title: str = "Convergence",
) -> None:  # fmt: skip
    """Write convergence curves: for each planner float[runs, iterations], the best length so far [cells].

    The line is the median of all runs, the band their 10th to 90th percentile; both begin where that many runs have a
    path.
    """
    with style():
        figure = empty_figure(7.0, 4.6)
        ax = figure.add_subplot()
        colours, most = name_colours(best), 1
        for name, values in best.items():
            lengths = np.atleast_2d(np.asarray(values, dtype=np.float64))
            most = max(most, lengths.shape[1])
            _curve(ax, name, lengths, hexed(colours[name]))
        if math.isfinite(optimum):
            ax.axhline(optimum, color=INK, lw=1, ls=(0, (5, 3)), label=f"optimum {optimum:.4f}")
        ax.set(xlabel="iteration", ylabel="best path length [cells]", xlim=(1, max(most, 2)))
        ax.set_title(title)
        ax.grid(axis="y")
        figure.legend(loc="outside lower center", ncols=2)
        save(figure, path)


def _curve(ax: Axes, name: str, lengths: NDArray[np.float64], colour: str) -> None:
    """Draw one planner's median and band."""
    count = len(lengths)
    found = int(np.isfinite(lengths[:, -1]).sum()) if lengths.shape[1] else 0
    if not found:
        ax.plot([], [], color=colour, lw=2, label=f"{name}: no path")
        return
    iterations = np.arange(1, lengths.shape[1] + 1)
    ranked = np.sort(np.where(np.isfinite(lengths), lengths, np.inf), axis=0)  # a run without a path is the longest
    low, middle, high = (ranked[math.ceil(share * count) - 1] for share in (0.1, 0.5, 0.9))
    shown, banded = np.isfinite(middle), np.isfinite(high)
    ax.fill_between(iterations[banded], low[banded], high[banded], color=colour, alpha=0.18, lw=0)
    runs = counted(count, "run") if found == count else f"{found} of {counted(count, 'run')} found a path"
    ax.plot(iterations[shown], middle[shown], color=colour, lw=2, label=f"{name} ({runs})")


def _sideways(line: NDArray[np.float64], shift: float) -> NDArray[np.float64]:
    """Move a polyline float[L, 2] to its left by `shift`, corners mitred."""
    if len(line) < 2 or shift == 0:
        return line
    step = np.diff(line, axis=0)
    step /= np.hypot(step[:, 0], step[:, 1])[:, None].clip(1e-12)
    left = np.stack([-step[:, 1], step[:, 0]], axis=1)
    before, after = np.vstack([left[:1], left]), np.vstack([left, left[-1:]])
    stretch = 1 + (before * after).sum(axis=1, keepdims=True)
    moved: NDArray[np.float64] = line + shift * (before + after) / stretch.clip(0.3)
    return moved


def floor_figure(grid: GridMap, title: str) -> tuple[Figure, Axes]:
    """Return a figure with a floor drawn in it, and its axes."""
    ratio = grid.shape[0] / grid.shape[1]
    width = 7.2 if ratio > 0.6 else 11.0
    figure = empty_figure(width, min(12.0, max(2.5, (width - 0.7) * ratio + 0.9)))
    ax = figure.add_subplot()
    draw_floor(ax, grid)
    ax.set_title(title)
    return figure, ax


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
