"""Learning curves: how runs of training came on, over the steps that their robots did."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.render.chart_style import ROUNDING, empty_figure, hexed, save, style
from warehouse_env.render.colours import name_colours
from warehouse_env.render.extras import load

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

_POINTS = 400  # at which the mean and the band of several runs are drawn
_MILLION = 1e6

# What is drawn: the key of a row, the label, whether the axis is logarithmic.
PANELS = (
    ("goals_per_robot_hour", "goals per robot-hour", False),
    ("collisions_per_km", "collisions per km", True),
    ("entropy", "entropy of the policy", False),
)


class Curve(NamedTuple):
    """One run: its algorithm, the agent-steps [T], growing, and for each key of PANELS the values [T], maybe nan."""

    algorithm: str
    steps: NDArray[np.float64]
    values: dict[str, NDArray[np.float64]]


def learning_curves(curves: Sequence[Curve], path: str | os.PathLike[str]) -> None:
    """Write the curves of all runs, a panel each of PANELS."""
    with style():
        figure = empty_figure(11.0, 3.6)
        draw_curves(figure, curves)
        save(figure, path)


def draw_curves(figure: FigureBase, curves: Sequence[Curve]) -> None:
    """Draw the panels beside each other: of each algorithm the line of its run, or the mean and the band of them."""
    algorithms = list(dict.fromkeys(curve.algorithm for curve in curves))
    colours = name_colours(algorithms)
    axes = figure.subplots(1, len(PANELS))
    for ax, (key, label, logarithmic) in zip(axes, PANELS, strict=True):
        for name in algorithms:
            own = [curve for curve in curves if curve.algorithm == name]
            text = name if len(own) == 1 else f"{name} ({len(own)} runs)"
            _draw(ax, own, key, hexed(colours[name]), text)
        if logarithmic:
            _logarithmic(ax, curves, key)
        else:
            ax.set_ylim(bottom=0)
        ax.set(xlabel="agent-steps [millions]", xlim=(0, None))
        ax.set_title(label)
        ax.grid(axis="y")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=min(6, len(algorithms)))


def _draw(ax: Axes, curves: Sequence[Curve], key: str, colour: str, text: str) -> None:
    steps, low, mean, high = spread(curves, key)
    if len(curves) > 1:
        ax.fill_between(steps / _MILLION, low, high, color=colour, alpha=0.2, lw=0)
    ax.plot(steps / _MILLION, mean, color=colour, lw=1.6, label=text)


def spread(curves: Sequence[Curve], key: str) -> tuple[NDArray[np.float64], ...]:
    """Return steps, lowest, mean and highest value of runs, each float64[T], where at least one has steps.

    One run is given as it is; of several each is interpolated between its rows and counts from its first to its last.
    """
    if len(curves) == 1:
        one = curves[0]
        return one.steps, one.values[key], one.values[key], one.values[key]
    steps = np.linspace(min(c.steps[0] for c in curves), max(c.steps[-1] for c in curves), _POINTS)
    lines = np.ma.masked_invalid([np.interp(steps, c.steps, c.values[key], left=np.nan, right=np.nan) for c in curves])
    low, mean, high = (
        np.ma.filled(line, np.nan) for line in (lines.min(axis=0), lines.mean(axis=0), lines.max(axis=0))
    )
    return steps, low, mean, high


def _logarithmic(ax: Axes, curves: Sequence[Curve], key: str) -> None:
    """Make the axis logarithmic; a value of 0 leads down to its lower end. Not so if all are 0."""
    ticker: Any = load("matplotlib.ticker")
    positive = [float(value) for curve in curves for value in curve.values[key] if value > ROUNDING]
    if not positive:
        ax.set_ylim(0, 1)
        return
    ax.set_yscale("log", nonpositive="clip")
    ax.set_ylim(min(positive) / 1.2, max(positive) * 1.2)
    ax.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_locator(ticker.NullLocator())
