"""Charts of several robots' routes: conflicts against the length paid for fewer, and where routes oppose each other."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.chart_style import FAINT, INK, empty_figure, hexed, save, style
from warehouse_env.render.charts import draw_floor
from warehouse_env.render.colours import CONTACT, name_colours


class Trade(NamedTuple):
    """A system at a price of conflicts: length paid [%], mean conflicts and their 95% interval."""

    system: str
    price: float
    paid: float
    conflicts: float
    low: float
    high: float


def trades(
    panels: Mapping[str, Sequence[Trade]], path: str | os.PathLike[str], title: str, price: float | None = None
) -> None:
    """Write conflicts against length paid, a panel a key; a system at several prices is joined by a line.

    price: the one whose points are drawn large.
    """
    with style():
        systems = list(dict.fromkeys(point.system for panel in panels.values() for point in panel))
        colours = name_colours(systems)
        figure = empty_figure(4.6 * max(1, len(panels)), 4.8)
        axes = np.atleast_1d(figure.subplots(1, max(1, len(panels))))
        for ax, (name, panel) in zip(axes, panels.items(), strict=True):
            for system in systems:
                own = sorted((point for point in panel if point.system == system), key=lambda point: point.price)
                if not own:
                    continue
                colour = hexed(colours[system])
                paid, met = [point.paid for point in own], [point.conflicts for point in own]
                ax.plot(paid, met, color=colour, lw=1.2, alpha=0.7)
                for point in own:
                    large = len(own) == 1 or point.price == price
                    reach = [[max(point.conflicts - point.low, 0.0)], [max(point.high - point.conflicts, 0.0)]]
                    ax.errorbar(
                        [point.paid], [point.conflicts], reach, fmt="o" if large else ".", color=colour,
                        ms=7 if large else 4, elinewidth=1, label=system if large else None,
                    )  # fmt: skip
            ax.set_title(name)
            ax.set_xlabel("longer than the shortest paths [%]")
            ax.set_ylim(bottom=0)
            ax.grid(True)
        axes[0].set_ylabel("expected conflicts a robot and task")
        handles = {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3)
        figure.suptitle(title, fontsize=12, x=0.01, ha="left")
        save(figure, path)


def opposing_streets(
    grid: GridMap, panels: Mapping[str, Sequence[NDArray[np.integer[Any]]]], path: str | os.PathLike[str]
) -> None:
    """Write the routes int[L, 2] of several robots on the floor, a panel a key; red where two drive against each other.

    A street that several routes use is drawn the wider.
    """
    with style():
        figure = empty_figure(6.2 * max(1, len(panels)), 6.4)
        for ax, (name, routes) in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels.items(), strict=True):
            draw_floor(ax, grid)
            steps: dict[tuple[tuple[int, int], tuple[int, int]], int] = {}
            for route in routes:
                cells = [(int(row), int(column)) for row, column in route.tolist()]
                for step in pairwise(cells):
                    steps[step] = steps.get(step, 0) + 1
            opposing = 0
            for (a, b), count in steps.items():
                against = steps.get((b, a), 0)
                opposing += 1 if against and a < b else 0
                line = grid.centre(np.array([a, b]))
                width = 0.8 + 0.5 * (count + against)
                colour = hexed(CONTACT) if against else INK
                ax.plot(
                    line[:, 0],
                    line[:, 1],
                    color=colour,
                    lw=width,
                    alpha=0.7 if against else 0.45,
                    solid_capstyle="round",
                )
            ax.set_title(name)
            ax.set_title(
                f"{len(routes)} routes, {opposing} steps driven in both directions",
                loc="right",
                fontsize=9.5,
                color=FAINT,
            )
        save(figure, path)
