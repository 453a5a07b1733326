"""Charts for reports: what was driven, planned and counted. Each policy or planner keeps its colour in all of them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.chart_style import INK, ROUNDING, empty_figure, figures, hexed, save, style
from warehouse_env.render.colours import CONTACT, RGB, SKY, name_colours, robot_colour
from warehouse_env.render.extras import load
from warehouse_env.render.floor import floor_image, scale_for
from warehouse_env.render.floor_axes import draw_arrows, set_metres

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDE = 1.6  # times the optimum, from which lengths are drawn on a logarithmic axis
_FLOOR_PIXELS = 1400  # of the floor's longer side in a chart


class Bar(NamedTuple):
    """One bar: a mean with its 95% interval, for a policy at a number of robots; nan where there is no figure."""

    policy: str
    robots: int
    mean: float
    low: float
    high: float


def draw_floor(ax: Axes, grid: GridMap) -> None:
    """Draw a floor into axes, in metres, equal in both directions, with arrows where cells are one way."""
    width, height = grid.shape[1] * grid.cell_size, grid.shape[0] * grid.cell_size
    image = floor_image(grid, scale_for(grid, _FLOOR_PIXELS, most=24.0))
    ax.imshow(image, extent=(0, width, 0, height), interpolation="antialiased")
    ax.set(xlabel="x [m]", ylabel="y [m]")
    set_metres(ax, grid)
    draw_arrows(ax, grid, grid.one_way, SKY)
    for side in ("top", "right"):
        ax.spines[side].set_visible(True)


def trajectories(
    grid: GridMap,
    tracks: Sequence[NDArray[np.floating[Any]]],
    hits: NDArray[np.floating[Any]],
    title: str,
    path: str | os.PathLike[str],
) -> None:
    """Write a picture of driven paths on the floor, with collisions marked.

    tracks: one float[T, 2] a robot [m] (nan breaks the line); hits: float[K, 2], where collisions happened [m].
    """
    with style():
        figure, ax = floor_figure(grid, title)
        for i, track in enumerate(tracks):
            track = np.asarray(track, dtype=np.float64).reshape(-1, 2)
            if not len(track):
                continue
            ax.plot(track[:, 0], track[:, 1], color=hexed(robot_colour(i)), lw=1.1, alpha=0.75, solid_joinstyle="round")
            ax.plot(*track[0], "o", ms=3.5, mfc="white", mec=hexed(robot_colour(i)), mew=1.1)
        hits = np.asarray(hits, dtype=np.float64).reshape(-1, 2)
        if len(hits):
            ax.scatter(hits[:, 0], hits[:, 1], s=110, color=hexed(CONTACT), alpha=0.22, lw=0, zorder=4)
            ax.scatter(hits[:, 0], hits[:, 1], s=26, marker="X", color=hexed(CONTACT), ec="white", lw=0.6, zorder=5)
        what = f"○ start of {_count(len(tracks), 'robot')}    ✖ {_count(len(hits), 'collision')}"
        ax.set_title(what, loc="right", fontsize=9.5)
        save(figure, path)


def paths(
    grid: GridMap,
    cells: Mapping[str, NDArray[np.number[Any]]],
    title: str,
    path: str | os.PathLike[str],
    notes: Mapping[str, str] | None = None,
    colours: Mapping[str, RGB] | None = None,
) -> None:
    """Write a picture of planned paths: for each planner int[L, 2] cells (row, col), or the float[K, 2] of a line.

    notes: what the legend says beside a planner's name, e.g. its path's length and turns; a planner without a path
    stands there as having none. colours: of the names, where several pictures are to agree.
    """
    with style():
        figure, ax = floor_figure(grid, title)
        colours = colours or name_colours(cells)
        shown = {name: np.asarray(way) for name, way in cells.items() if len(way)}
        for k, (name, way) in enumerate(shown.items()):
            # Side by side, so that shared stretches show every planner.
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
    best: Mapping[str, NDArray[np.floating[Any]]],
    optimum: float,
    path: str | os.PathLike[str],
    title: str = "Convergence",
    colours: Mapping[str, RGB] | None = None,
) -> None:
    """Write convergence curves: for each planner float[runs, iterations], the best length so far [cells].

    The line is the median of all runs, the band their 10th to 90th percentile; both begin where so many runs have a
    path. The lengths are on a logarithmic axis where they differ widely. colours: of the names, as for `paths`.
    """
    with style():
        figure = empty_figure(7.0, 4.6)
        ax = figure.add_subplot()
        colours = colours or name_colours(best)
        most, tallest = 1, 0.0
        for name, values in best.items():
            lengths = np.atleast_2d(np.asarray(values, dtype=np.float64))
            most = max(most, lengths.shape[1])
            tallest = max(tallest, _curve(ax, name, lengths, hexed(colours[name])))
        if math.isfinite(optimum):
            ax.axhline(optimum, color=INK, lw=1, ls=(0, (5, 3)), label=f"optimum {optimum:.4f}")
            if tallest > _WIDE * optimum > 0:
                _length_scale(ax, optimum, tallest)
        ax.set(xlabel="iteration", ylabel="best path length [cells]", xlim=(1, max(most, 2)))
        ax.set_title(title)
        ax.grid(axis="y")
        figure.legend(loc="outside lower center", ncols=2)
        save(figure, path)


def _curve(ax: Axes, name: str, lengths: NDArray[np.float64], colour: str) -> float:
    """Draw one planner's median and band; return the largest length drawn."""
    count = len(lengths)
    found = int(np.isfinite(lengths[:, -1]).sum()) if lengths.shape[1] else 0
    if not found:
        ax.plot([], [], color=colour, lw=2, label=f"{name}: no path")
        return 0.0
    iterations = np.arange(1, lengths.shape[1] + 1)
    ranked = np.sort(np.where(np.isfinite(lengths), lengths, np.inf), axis=0)  # a run without a path is the longest
    low, middle, high = (ranked[math.ceil(share * count) - 1] for share in (0.1, 0.5, 0.9))
    shown, banded = np.isfinite(middle), np.isfinite(high)
    ax.fill_between(iterations[banded], low[banded], high[banded], color=colour, alpha=0.18, lw=0)
    runs = _count(count, "run") if found == count else f"{found} of {_count(count, 'run')} found a path"
    ax.plot(iterations[shown], middle[shown], color=colour, lw=2, label=f"{name} ({runs})")
    drawn = np.concatenate([middle[shown], high[banded]])
    return float(drawn.max()) if len(drawn) else 0.0


def _length_scale(ax: Axes, shortest: float, longest: float) -> None:
    """Make the axis of lengths logarithmic, with a few round numbers on it."""
    ticker = load("matplotlib.ticker")
    ax.set_yscale("log")
    ax.set_ylim(shortest * 0.95, longest * 1.1)
    ax.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
    ax.yaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_locator(ticker.NullLocator())


def collision_bars(
    collisions: Sequence[Bar | tuple[str, int, float, float, float]],
    goals: Sequence[Bar | tuple[str, int, float, float, float]],
    path: str | os.PathLike[str],
    title: str = "",
) -> None:
    """Write two bar charts: collisions per robot-km (logarithmic, with room for zero) and goals per robot-hour.

    Each row is (policy, robots, mean, low, high), low and high the 95% interval; `goals` may be empty.
    """
    with style():
        panels = [[Bar(*row) for row in rows] for rows in (collisions, goals) if len(rows)]
        groups = max((len(panel) for panel in panels), default=1)
        figure = empty_figure(max(4.6, 1.4 + 0.48 * groups) * max(1, len(panels)), 4.4)
        figure.get_layout_engine().set(w_pad=0.12)  # type: ignore[union-attr,call-arg]
        axes = np.atleast_1d(figure.subplots(1, max(1, len(panels))))
        for ax, bars in zip(axes, panels, strict=False):
            _bars(ax, bars)
        if len(collisions):
            collision_scale(axes[0], [bar for bar in panels[0] if math.isfinite(bar.mean)])
            axes[0].set_ylabel("collisions per robot-km")
            axes[0].set_title("Collisions (less is better)")
        if len(goals):
            axes[-1].set_ylabel("goals per robot-hour")
            axes[-1].set_title("Throughput (more is better)")
            axes[-1].margins(y=0.14)
            axes[-1].set_ylim(bottom=0)
        if panels:
            handles, labels = axes[0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside lower center", ncols=min(6, len(labels)))
        if title:
            figure.suptitle(title, fontsize=12, x=0.01, ha="left")
        save(figure, path)


def _bars(ax: Axes, bars: Sequence[Bar]) -> None:
    """Groups of robots, in each a bar a policy, its interval and its mean in figures."""
    policies = list(dict.fromkeys(bar.policy for bar in bars))
    counts = sorted({bar.robots for bar in bars})
    colours = name_colours(policies)
    width = 0.8 / len(policies)
    for k, policy in enumerate(policies):
        own = [bar for bar in bars if bar.policy == policy]
        places = [counts.index(bar.robots) + (k - (len(policies) - 1) / 2) * width for bar in own]
        means = np.nan_to_num([bar.mean for bar in own], nan=0.0)
        ax.bar(places, means, width * 0.88, color=hexed(colours[policy]), label=policy)
        reach = np.array([(bar.mean - max(bar.low, 0.0), bar.high - bar.mean) for bar in own]).reshape(-1, 2).T
        reach = np.where(np.isfinite(reach), reach, 0.0).clip(0)
        ax.errorbar(places, means, reach, fmt="none", ecolor=INK, elinewidth=1, capsize=3, capthick=1)
        for place, bar, above in zip(places, own, reach[1], strict=True):
            ax.annotate(
                figures(bar.mean), (place, np.nan_to_num(bar.mean) + above), xytext=(0, 3), textcoords="offset points",
                ha="center", va="bottom", fontsize=8.5, color=INK,
            )  # fmt: skip
    ax.set_xticks(range(len(counts)), [_count(count, "robot") for count in counts])
    ax.set_xlim(-0.5, len(counts) - 0.5)
    ax.tick_params(axis="x", length=0)
    ax.grid(axis="y")


def collision_scale(ax: Axes, bars: Sequence[Bar]) -> None:
    """Logarithmic, but linear below the decade of the smallest figure, so that zero has its place."""
    positive = [value for bar in bars for value in (bar.mean, bar.high) if math.isfinite(value) and value > ROUNDING]
    if not positive:
        ax.set_ylim(0, 1)
        return
    smallest = min((bar.mean for bar in bars if bar.mean > ROUNDING), default=min(positive))
    threshold = 10.0 ** math.floor(math.log10(smallest))
    ax.set_yscale("symlog", linthresh=threshold, linscale=0.5)
    ax.set_ylim(0, max(positive) * 2.2)
    ticker = load("matplotlib.ticker")
    top = math.ceil(math.log10(max(positive) * 2.2))
    decades = [10.0**power for power in range(round(math.log10(threshold)), top + 1)]
    ax.yaxis.set_major_locator(ticker.FixedLocator([0.0, *decades]))
    ax.yaxis.set_minor_locator(ticker.NullLocator())
    ax.yaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


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
    ratio = grid.shape[0] / grid.shape[1]
    width = 7.2 if ratio > 0.6 else 11.0
    figure = empty_figure(width, min(12.0, max(2.5, (width - 0.7) * ratio + 0.9)))
    ax = figure.add_subplot()
    draw_floor(ax, grid)
    ax.set_title(title)
    return figure, ax
