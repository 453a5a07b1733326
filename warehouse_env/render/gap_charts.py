"""How a planner's excess over the shortest path is spread: its mean, its usual bad cases, its worst."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from warehouse_env.render.chart_style import FAINT, INK, empty_figure, fails, hexed, save, style
from warehouse_env.render.colours import CONTACT, name_colours
from warehouse_env.render.extras import load

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LINEAR = 0.1  # [%] below it the axis is linear, so that zero has its place
_COLUMNS = 3


class Spread(NamedTuple):
    """Gaps [%] of a planner's runs that found a path, nan where none did; failed: share [0, 1] of all runs."""

    name: str
    mean: float
    median: float
    p95: float
    p99: float
    worst: float
    failed: float


def gap_spreads(panels: Mapping[str, Sequence[Spread]], path: str | os.PathLike[str], title: str = "") -> None:
    """Write the spread of the gaps, a panel a key, a line a planner in the order given, first on top.

    The bar reaches from the median to the 95th percentile, the line to the 99th, the cross is the worst, the dot the
    mean; failures stand at the right in red.
    """
    with style():
        spreads = [spread for panel in panels.values() for spread in panel]
        colours = name_colours(dict.fromkeys(spread.name for spread in spreads))
        columns = max(1, min(_COLUMNS, len(panels)))
        rows = max(1, math.ceil(len(panels) / columns))
        lines = max((len(panel) for panel in panels.values()), default=1)
        figure = empty_figure(5.2 * columns, (1.1 + 0.26 * lines) * rows + 0.5)
        grid = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel().tolist()
        most = max((s.worst for s in spreads if math.isfinite(s.worst)), default=1.0)
        for ax, (name, panel) in zip(grid, panels.items(), strict=False):
            _scale(ax, most)
            ax.set_title(name)
            for place, spread in enumerate(panel):
                _draw(ax, place, spread, hexed(colours[spread.name]))
            ax.set_yticks(range(len(panel)), [spread.name for spread in panel])
            ax.set_ylim(len(panel) - 0.4, -0.6)
            ax.tick_params(axis="y", length=0)
            ax.set_xlabel("longer than the shortest path [%]")
        for ax in grid[len(panels) :]:
            ax.set_axis_off()
        legend = (
            "dot: mean    bar: median to 95th percentile    line: to the 99th    cross: worst    red: runs that failed"
        )
        figure.supxlabel(legend, fontsize=9, color=FAINT)
        if title:
            figure.suptitle(title, fontsize=12, x=0.01, ha="left")
        save(figure, path)


def _scale(ax: Axes, most: float) -> None:
    ticker = load("matplotlib.ticker")
    power = max(0, math.ceil(math.log10(max(most, _LINEAR) * 1.05)))
    ax.set_xscale("symlog", linthresh=_LINEAR, linscale=0.6)
    ticks = [0.0, *(10.0**k for k in range(round(math.log10(_LINEAR)), power + 1))]
    ax.xaxis.set_major_locator(ticker.FixedLocator(ticks))
    ax.xaxis.set_minor_locator(ticker.NullLocator())
    ax.xaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    ax.set_xlim(-0.02, 10.0**power * 1.3)
    ax.grid(axis="x")


def _draw(ax: Axes, place: int, spread: Spread, colour: str) -> None:
    if math.isfinite(spread.mean):
        ax.plot([spread.median, spread.p99], [place, place], color=colour, lw=1.2)
        ax.plot([spread.median, spread.p95], [place, place], color=colour, lw=6, alpha=0.45, solid_capstyle="butt")
        ax.plot(spread.worst, place, "x", color=colour, ms=5, mew=1.2, clip_on=False)
        ax.plot(spread.mean, place, "o", color=colour, mec=INK, mew=0.6, ms=5.5, clip_on=False, zorder=4)
    if spread.failed > 0:
        text = fails(spread.failed)
        ax.annotate(
            text, (1.0, place), xycoords=("axes fraction", "data"), xytext=(3, 0), textcoords="offset points",
            va="center", color=hexed(CONTACT), fontsize=8.5, annotation_clip=False,
        )  # fmt: skip
