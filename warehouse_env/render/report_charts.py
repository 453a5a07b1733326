"""Charts of evaluations and reports: measures over robots, throughput."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from warehouse_env.render.chart_style import FAINT, INK, empty_figure, hexed, log_scale, save, style, svg
from warehouse_env.render.colours import BLUE, CONTACT, GREEN, GREY, RGB, name_colours
from warehouse_env.render.extras import load as module

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_APART = 0.13  # of the distance between two numbers of robots: how far policies are apart


class Bar(NamedTuple):
    """A mean with its 95% interval, for a policy at a number of robots; nan where there is no figure."""

    policy: str
    robots: int
    mean: float
    low: float
    high: float


class FloorLoad(NamedTuple):
    """The throughput of a floor with a number of robots: goals per hour of all, with the 95% interval."""

    robots: int
    mean: float
    low: float
    high: float
    jammed: bool


COLLISIONS = "collisions per robot-km"
Measures = Mapping[str, Mapping[str, Sequence[Bar]]]
"""Floor -> title of a measure -> its figures."""


def over_robots(floors: Measures, label: str) -> str:
    """Draw measures over the number of robots as SVG, a row of panels a floor."""
    with style():
        return svg(_over_robots(floors), label)


def draw_over_robots(floors: Measures, path: Path) -> None:
    """Write the drawing of `over_robots` as a picture."""
    with style():
        save(_over_robots(floors), path)


def _over_robots(floors: Measures) -> Figure:
    figure = empty_figure(10.0, 3.1 * len(floors) + 0.4)
    axes = figure.subplots(len(floors), max(map(len, floors.values())), squeeze=False)
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.1)  # type: ignore[union-attr,call-arg]
    for line, (floor, measures) in zip(axes, floors.items(), strict=True):
        for ax, (title, bars) in zip(line, measures.items(), strict=True):
            _dots(ax, bars)
            if title == COLLISIONS:
                log_scale(ax, [value for bar in bars for value in (bar.mean, bar.high)])
            else:
                ax.margins(y=0.15)
                ax.set_ylim(bottom=0)
            ax.set(title=f"{floor}: {title}", xlabel="robots")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=6)
    return figure


def _dots(ax: Axes, bars: Sequence[Bar]) -> None:
    """Draw a dot with its interval for each policy and number of robots; a line joins the dots of a policy."""
    counts = sorted({bar.robots for bar in bars})
    policies = list(dict.fromkeys(bar.policy for bar in bars))
    for k, (policy, colour) in enumerate(name_colours(policies).items()):
        own = sorted((bar for bar in bars if bar.policy == policy), key=lambda bar: bar.robots)
        at = [counts.index(bar.robots) + (k - (len(policies) - 1) / 2) * _APART for bar in own]
        means = [bar.mean for bar in own]
        reach = np.array([(bar.mean - max(bar.low, 0.0), bar.high - bar.mean) for bar in own]).T
        ax.plot(at, means, color=hexed(colour), lw=1.2, alpha=0.5)
        ax.errorbar(
            at, means, np.nan_to_num(reach).clip(0), fmt="o", ms=5, color=hexed(colour), elinewidth=1.5, capsize=3,
            label=policy, clip_on=False,
        )  # fmt: skip
    ax.set_xticks(range(len(counts)), [str(count) for count in counts])
    ax.set_xlim(-0.5, len(counts) - 0.5)
    ax.grid(axis="y")


def throughput(
    loads: Sequence[FloorLoad], alone: float, most: FloorLoad, knee: tuple[float, float, float] | None, label: str,
    what: str = "goals",
) -> str:  # fmt: skip
    """Draw the goals per hour of a whole floor over its robots; alone: those of a single robot.

    most: the answer, drawn large. knee: number of robots from which another one adds half of `alone`, with its
    interval. what: the name of what is counted, if not goals.
    """
    with style():
        figure = empty_figure(7.6, 3.6)
        ax = figure.add_subplot()
        loads = sorted(loads)
        robots, means = [load.robots for load in loads], [load.mean for load in loads]
        top = max([1e-9, *means, *(load.high for load in [*loads, most] if np.isfinite(load.high))])
        ax.plot([0, robots[-1]], [0, alone * robots[-1]], color=FAINT, lw=1.2, ls=(0, (4, 3)), label="none in the way")
        ax.plot(robots, means, color=hexed(BLUE), lw=1.6)
        for load in loads:
            _dot(ax, load, *((CONTACT, "X") if load.jammed else (BLUE, "o")), 6)
        _dot(ax, most, GREEN, "o", 11)
        if knee is not None:
            at, low, high = knee
            ax.axvspan(low, min(high, robots[-1]), color=hexed(GREY), alpha=0.18, lw=0)
            ax.axvline(at, color=INK, lw=1.2, label=f"a further one adds half, from {at:.0f}")
        shapes = [("o", GREEN, f"most {what}, {most.robots} robots"), ("o", BLUE, "drives"), ("X", CONTACT, "jams")]
        for marker, colour, text in shapes if any(load.jammed for load in loads) else shapes[:2]:
            ax.plot([], [], marker, color=hexed(colour), label=text)
        ax.set(xlim=(0, robots[-1] * 1.05), ylim=(0, top * 1.12))
        ax.set(xlabel="robots", ylabel=f"{what} per hour, all robots")
        ax.xaxis.set_major_locator(module("matplotlib.ticker").MaxNLocator(9, steps=[1, 2, 5, 10], integer=True))
        ax.grid(axis="y")
        figure.legend(loc="outside upper left", ncols=5)
        return svg(figure, label)


def _dot(ax: Axes, load: FloorLoad, colour: RGB, marker: str, size: float) -> None:
    reach = np.nan_to_num([[load.mean - max(load.low, 0.0)], [load.high - load.mean]]).clip(0)
    ax.errorbar([load.robots], [load.mean], reach, fmt=marker, ms=size, color=hexed(colour), elinewidth=1.4, capsize=3)
