"""Axes for pictures of a floor: metres in the map's own frame, and arrows on one-way cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.chart_style import hexed
from warehouse_env.render.colours import RGB
from warehouse_env.render.extras import load

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ALONG = {1: (1, 0), 2: (0, 1), 3: (-1, 0), 4: (0, -1)}  # one_way.ARROWS as (x, y)
_MOST_TICKS = 8
_LENGTH = 0.7  # [cells] of an arrow


def set_metres(ax: Axes, grid: GridMap) -> None:
    """Show all of a floor, equal in both directions, with ticks at round metres of the map's own frame."""
    sides = grid.shape[1] * grid.cell_size, grid.shape[0] * grid.cell_size
    ax.set(xlim=(0, sides[0]), ylim=(0, sides[1]))
    locator = load("matplotlib.ticker").MaxNLocator(_MOST_TICKS, steps=[1, 2, 5, 10])
    for axis, shift, side in zip((ax.xaxis, ax.yaxis), grid.origin, sides, strict=True):
        if shift:
            round_ones = [tick for tick in locator.tick_values(shift, shift + side) if 0 <= tick - shift <= side]
            axis.set_ticks([tick - shift for tick in round_ones], [f"{tick:.6g}" for tick in round_ones])
    ax.set_aspect("equal")


def draw_arrows(ax: Axes, grid: GridMap, one_way: NDArray[np.uint8], colour: RGB) -> None:
    """Draw the direction of every one-way cell; one_way: uint8[H, W], as in GridMap."""
    cells = np.argwhere(one_way)
    if not len(cells):
        return
    x, y = grid.centre(cells).T
    along = np.array([_ALONG[int(one_way[row, column])] for row, column in cells], dtype=np.float64)
    ax.quiver(
        x, y, *(_LENGTH * grid.cell_size * along).T, pivot="mid", angles="xy", scale_units="xy", scale=1.0, units="xy",
        color=hexed(colour), headwidth=4, headlength=4, headaxislength=3.6, width=0.09 * grid.cell_size, zorder=2.5,
    )  # fmt: skip
