"""Charts of many planners at once: what their paths cost in time, all told and as time goes by."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.render.chart_style import FAINT, INK, empty_figure, fails, hexed, save, style
from warehouse_env.render.colours import CONTACT, name_colours
from warehouse_env.render.extras import load

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

_MARKERS = "sod^vPXD*"  # one a family, in the order in which families first appear
_LINES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
_LINEAR = 0.1  # [%] below it the axis of gaps is linear, so that zero has its place
_PLACES = [(7, 0, "left", "center"), (-7, 0, "right", "center"), (0, 7, "center", "bottom"), (0, -7, "center", "top")]
_PLACES += [(dx * s, dy * s, "left" if dx > 0 else "right", "bottom" if dy > 0 else "top")
            for s in (1, 2, 4, 7) for dx, dy in ((5, 5), (5, -5), (-5, 5), (-5, -5))]  # fmt: skip


class Point(NamedTuple):
    """A planner over a set of runs.

    family: planners of one family share a marker; ms: median time of a plan; gap, low, high: mean excess over the
    shortest length of the runs that found a path and its 95% interval [%], nan where none did; failed: share [0, 1].
    """

    name: str
    family: str
    ms: float
    gap: float
    low: float
    high: float
    failed: float


class Curve(NamedTuple):
    """How good a planner's best path is after some time: gap float[K] [%] from ms float[K] on, ms ascending."""

    name: str
    family: str
    ms: NDArray[np.float64]
    gap: NDArray[np.float64]


def pareto(panels: Mapping[str, Sequence[Point]], path: str | os.PathLike[str], title: str = "") -> None:
    """Write gap against time, a panel a key: planners to the lower left are better. Failures are hollow and in red.

    The grey line joins the planners that always find a path and that no other such planner beats in both.
    """
    with style():
        points = [point for panel in panels.values() for point in panel]
        figure, axes = _panels(panels, title)
        colours = name_colours(point.name for point in points)
        markers = _by_family(points, _MARKERS)
        top = _gap_axis(axes, [v for p in points for v in (p.gap, p.high)], any(p.failed >= 1 for p in points))
        _time_axis(axes, [point.ms for point in points])
        for ax, panel in zip(axes, panels.values(), strict=False):
            _frontier(ax, panel, top)
            for point in panel:
                _point(ax, point, hexed(colours[point.name]), markers[point.family], top)
        handles = [axes[0].plot([], [], m, color=FAINT, ms=7, label=family)[0] for family, m in markers.items()]
        figure.legend(handles=handles, loc="outside lower center", ncols=6)
        figure.draw_without_rendering()
        for ax, panel in zip(axes, panels.values(), strict=False):
            _label(ax, panel, top)
        save(figure, path)


def anytime(panels: Mapping[str, Sequence[Curve]], path: str | os.PathLike[str], title: str = "") -> None:
    """Write how the best path's gap falls as time goes by, a panel a key; a planner that does not iterate is a dot."""
    with style():
        curves = [curve for panel in panels.values() for curve in panel if np.isfinite(curve.gap).any()]
        figure, axes = _panels(panels, title)
        colours, lines = name_colours(curve.name for curve in curves), _by_family(curves, _LINES)
        _gap_axis(axes, [float(v) for curve in curves for v in curve.gap], False)
        times = [float(ms) for curve in curves for ms in curve.ms[np.isfinite(curve.gap)]]
        _time_axis(axes, times)
        end = max(times, default=1.0) * 2
        handles: dict[str, Any] = {}
        for ax, panel in zip(axes, panels.values(), strict=False):
            for curve in panel:
                if not np.isfinite(curve.gap).any():
                    continue
                ms, gap = curve.ms[np.isfinite(curve.gap)], curve.gap[np.isfinite(curve.gap)]
                look: dict[str, Any] = {"color": hexed(colours[curve.name]), "ls": lines[curve.family], "lw": 1.8}
                drawn = ax.plot([*ms, end], [*gap, gap[-1]], drawstyle="steps-post", label=curve.name, **look)[0]
                ax.plot(ms[0], gap[0], "o", ms=4, color=look["color"])
                handles.setdefault(curve.name, drawn)
        figure.legend(handles=list(handles.values()), loc="outside lower center", ncols=6, handlelength=3)
        save(figure, path)


def _panels(panels: Mapping[str, object], title: str) -> tuple[Any, list[Axes]]:
    """Return a figure with one axes a panel, titled, all with the same scales."""
    count = max(1, len(panels))
    columns = count if count < 3 else math.ceil(count / 2) if count < 5 else 3
    rows = math.ceil(count / columns)
    figure = empty_figure(min(15.0, 8.0 if count == 1 else 5.4 * columns), 0.9 + (5.0 if count == 1 else 4.1) * rows)
    grid = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)).ravel().tolist()
    for ax, name in zip(grid, panels, strict=False):
        ax.set_title(name)
    for ax in grid[len(panels) :]:
        ax.set_axis_off()
    for k, ax in enumerate(grid[: len(panels)]):
        if k % columns == 0:
            ax.set_ylabel("longer than the shortest path [%]")
        if k + columns >= len(panels):
            ax.set_xlabel("time of a plan [ms]")
            ax.tick_params(labelbottom=True)
    if title:
        figure.suptitle(title, fontsize=12, x=0.01, ha="left")
    return figure, grid


def _by_family(shown: Sequence[Point] | Sequence[Curve], choice: Sequence[Any]) -> dict[str, Any]:
    families = dict.fromkeys(item.family for item in shown)
    return {family: choice[k % len(choice)] for k, family in enumerate(families)}


def _gap_axis(axes: Sequence[Axes], gaps: Sequence[float], lost: bool) -> float:
    """Make the axis of gaps logarithmic with room for zero; return where planners without any path are drawn [%]."""
    ticker = load("matplotlib.ticker")
    most = max((gap for gap in gaps if math.isfinite(gap)), default=1.0)
    power = max(0, math.ceil(math.log10(max(most, _LINEAR) * 1.2)))
    top = 10.0**power * 3
    decades = [10.0**k for k in range(round(math.log10(_LINEAR)), power + 1)]
    for ax in axes:
        ax.set_yscale("symlog", linthresh=_LINEAR, linscale=0.6)
        ax.yaxis.set_major_locator(ticker.FixedLocator([0.0, *decades, *([top] if lost else [])]))
        ax.yaxis.set_minor_locator(ticker.NullLocator())
        ax.yaxis.set_major_formatter(
            ticker.FuncFormatter(lambda value, _: "no path" if lost and value >= top * 0.99 else f"{value:g}")
        )
        ax.set_ylim(-0.045, top * 1.8 if lost else 10.0**power)
        ax.grid(axis="both")
    return top


def _time_axis(axes: Sequence[Axes], times: Sequence[float]) -> None:
    ticker = load("matplotlib.ticker")
    known = [ms for ms in times if math.isfinite(ms) and ms > 0] or [1.0]
    for ax in axes:
        ax.set_xscale("log")
        ax.set_xlim(min(known) / 2, max(known) * 2)
        ax.xaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
        ax.xaxis.set_minor_locator(ticker.NullLocator())


def _height(point: Point, top: float) -> float:
    return point.gap if math.isfinite(point.gap) else top


def _point(ax: Axes, point: Point, colour: str, marker: str, top: float) -> None:
    if math.isfinite(point.low) and math.isfinite(point.high):
        ax.plot([point.ms, point.ms], [max(point.low, 0.0), point.high], color=colour, lw=1.2, alpha=0.7)
    look = {"mfc": "white" if point.failed else colour, "mec": colour, "mew": 1.6}
    ax.plot(point.ms, _height(point, top), marker, ms=8, zorder=4, clip_on=False, **look)  # type: ignore[arg-type]


def _frontier(ax: Axes, panel: Sequence[Point], top: float) -> None:
    """Draw the steps below which no planner that always finds a path gets."""
    sure = sorted((point.ms, max(point.gap, 0.0)) for point in panel if not point.failed and math.isfinite(point.gap))
    steps: list[tuple[float, float]] = []
    for ms, gap in sure:
        if not steps or gap < steps[-1][1] - 1e-9:
            steps.append((ms, gap))
    if steps:
        line = [(steps[0][0], top * 2), *steps, (ax.get_xlim()[1], steps[-1][1])]
        ax.plot(*zip(*line, strict=True), color="#b9bec5", lw=1.4, drawstyle="steps-post", zorder=1)


def _label(ax: Axes, panel: Sequence[Point], top: float) -> None:
    """Write each planner's name beside its point, where it covers no other name and no point."""
    # `draw_without_rendering` has settled the layout; from here on display coordinates are final.
    places = [ax.transData.transform((point.ms, _height(point, top))) for point in panel]
    taken: list[tuple[float, ...]] = [(x - 5, y - 5, x + 5, y + 5) for x, y in places]
    for point in sorted(panel, key=lambda p: (p.gap if math.isfinite(p.gap) else top, p.ms)):
        lost = f" {fails(point.failed)}" if point.failed else ""
        best: tuple[float, Annotation] | None = None
        for dx, dy, ha, va in _PLACES:
            far = max(abs(dx), abs(dy)) > 12
            text = ax.annotate(
                point.name + lost, (point.ms, _height(point, top)), xytext=(dx, dy), textcoords="offset points",
                ha=ha, va=va, fontsize=8, color=hexed(CONTACT) if lost else INK, zorder=6, annotation_clip=False,
                bbox={"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.75},
                arrowprops={"arrowstyle": "-", "color": FAINT, "lw": 0.6, "shrinkB": 5} if far else None,
            )  # fmt: skip
            box = text.get_window_extent().padded(1)
            covered = sum(_overlap(box.extents, other) for other in taken) + _outside(ax, box.extents)
            if best is None or covered < best[0] - 1e-9:
                if best is not None:
                    best[1].remove()
                best = (covered, text)
            else:
                text.remove()
            if covered == 0:
                break
        assert best is not None
        taken.append(tuple(best[1].get_window_extent().extents))


def _overlap(box: Sequence[float], other: Sequence[float]) -> float:
    width, height = min(box[2], other[2]) - max(box[0], other[0]), min(box[3], other[3]) - max(box[1], other[1])
    return width * height if width > 0 and height > 0 else 0.0


def _outside(ax: Axes, box: Sequence[float]) -> float:
    """How much of a box [px] lies beyond the axes, which would run into the neighbouring panel."""
    edge = ax.bbox.extents
    return 20 * (max(0.0, edge[0] - box[0]) + max(0.0, box[2] - edge[2]) + max(0.0, box[3] - edge[3] - 4))
