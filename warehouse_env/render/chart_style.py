"""Parts that all charts share: fonts and inks, an empty figure, writing it as a file or as SVG, scales, floors."""

from __future__ import annotations

import html
import io
import math
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.files import complete_file
from warehouse_env.render.colours import RGB
from warehouse_env.render.extras import load

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from warehouse_env.maps.grid_map import GridMap

DPI = 150
PICTURES = (".png", ".svg", ".pdf", ".jpg", ".jpeg", ".webp", ".tif", ".tiff")
ROUNDING = 1e-9  # smaller values are rounding errors of zero
INK = "#2b3038"
FAINT = "#5f6771"
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.titlepad": 9,
    "axes.titlecolor": INK,
    "text.color": INK,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": "#e3e5e8",
    "grid.linewidth": 0.8,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
}
_PAGE_INKS = {INK: "ink", FAINT: "faint", STYLE["grid.color"]: "rule", "#ffffff": "paper"}
_NOT_DATED = {"Date": None, "Creator": None}
_ALONG = {1: (1, 0), 2: (0, 1), 3: (-1, 0), 4: (0, -1)}  # one_way.ARROWS as (x, y)
_MOST_TICKS = 8
_LENGTH = 0.7  # [cells] of an arrow


def style() -> Any:
    """Return the matplotlib context in which a chart is drawn."""
    return load("matplotlib").rc_context(STYLE)


def empty_figure(width: float, height: float, dpi: int = DPI) -> Figure:
    """Return a figure of width x height [inches] without a window."""
    figure: Figure = load("matplotlib.figure").Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    load("matplotlib.backends.backend_agg").FigureCanvasAgg(figure)
    return figure


def check_picture(path: str | os.PathLike[str]) -> None:
    """Raise ConfigError for a picture with an unknown suffix."""
    if Path(path).suffix.lower() not in PICTURES:
        raise ConfigError(f"picture {path} must end in one of {', '.join(PICTURES)}")


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure, all of it or nothing; WarehouseError where it cannot be written."""
    check_picture(path)
    with complete_file(path) as part:
        figure.savefig(part, facecolor="white", bbox_inches="tight", pad_inches=0.12)


def svg(figure: Figure, label: str) -> str:
    """Return a figure as SVG for a page, in the page's inks (--ink, --faint, --rule); label: for screen readers."""
    text = io.StringIO()
    with load("matplotlib").rc_context({"svg.fonttype": "none", "svg.hashsalt": label}):
        figure.savefig(text, format="svg", transparent=True, bbox_inches="tight", pad_inches=0.05, metadata=_NOT_DATED)
    drawing = re.sub(r' id="\w+_\d+"| <metadata>.*?</metadata>\n', "", text.getvalue(), flags=re.DOTALL)
    drawing = drawing[drawing.index("<svg") :]
    for ink, name in _PAGE_INKS.items():
        drawing = drawing.replace(ink, f"var(--{name})")
    width, height = (float(side) for side in re.findall(r'(?:width|height)="([\d.]+)pt"', drawing)[:2])
    box = f'viewBox="0 0 {width:g} {height:g}" style="max-width: {1.5 * width:.0f}px"'
    names = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    return f'<svg role="img" aria-label="{html.escape(label)}" {names} {box}{drawing[drawing.index(">") :]}'


def hexed(colour: RGB) -> str:
    """Return a colour as matplotlib reads it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def draw_discs(ax: Axes, grid: GridMap, colour: RGB, alpha: float = 1.0) -> None:
    """Draw a floor's discs into axes in metres."""
    for x, y, radius in grid.discs.tolist():
        ax.add_patch(load("matplotlib.patches").Circle((x, y), radius, color=hexed(colour), alpha=alpha, lw=0))


def set_metres(ax: Axes, grid: GridMap) -> None:
    """Show all of a floor in a frame, equal in both directions, with ticks at round metres of the map's own frame.

    A turned map has no such ticks; the floor's own metres stand there.
    """
    sides = grid.shape[1] * grid.cell_size, grid.shape[0] * grid.cell_size
    ax.set(xlim=(0, sides[0]), ylim=(0, sides[1]))
    locator = load("matplotlib.ticker").MaxNLocator(_MOST_TICKS, steps=[1, 2, 5, 10])
    for axis, shift, side in zip((ax.xaxis, ax.yaxis), grid.origin, sides, strict=True):
        if shift and not grid.yaw:
            round_ones = [tick for tick in locator.tick_values(shift, shift + side) if 0 <= tick - shift <= side]
            axis.set_ticks([tick - shift for tick in round_ones], [f"{tick:.6g}" for tick in round_ones])
    ax.set_aspect("equal")
    for edge in ax.spines.values():
        edge.set_visible(True)


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


def log_scale(ax: Axes, values: Iterable[float]) -> None:
    """Make the y axis logarithmic down to the decade of the smallest positive value, and linear from there to zero."""
    positive = [value for value in values if math.isfinite(value) and value > ROUNDING]
    if not positive:
        ax.set_ylim(0, 1)
        return
    lowest = math.floor(math.log10(min(positive)))
    ax.set_yscale("symlog", linthresh=10.0**lowest, linscale=0.5)
    ax.set_ylim(0, max(positive) * 2.2)
    ticker = load("matplotlib.ticker")
    decades = [10.0**power for power in range(lowest, math.ceil(math.log10(max(positive) * 2.2)) + 1)]
    ax.yaxis.set_major_locator(ticker.FixedLocator([0.0, *decades]))
    ax.yaxis.set_minor_locator(ticker.NullLocator())
    ax.yaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
