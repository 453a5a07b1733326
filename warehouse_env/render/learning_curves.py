"""Learning curves: goals, collisions and entropy of training runs over agent-steps."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.render.chart_style import empty_figure, hexed, log_scale, save, style
from warehouse_env.render.colours import name_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

_POINTS = 400  # of the mean and the band of several runs
_MILLION = 1e6

# The key of a row, the label, whether the axis is logarithmic.
PANELS = (
    ("goals_per_robot_hour", "goals per robot-hour", False),
    ("collisions_per_km", "collisions per km", True),
    ("entropy", "entropy of the policy", False),
)


class Curve(NamedTuple):
    """One run: its algorithm, the growing agent-steps [T], and for each key of PANELS the values [T], maybe nan."""

    algorithm: str
    steps: NDArray[np.float64]
    values: dict[str, NDArray[np.float64]]


def learning_curves(curves: Sequence[Curve], path: str | os.PathLike[str]) -> None:
    """Write the curves of all runs, a panel for each of PANELS."""
    with style():
        figure = empty_figure(11.0, 3.6)
        draw_curves(figure, curves)
        save(figure, path)


def draw_curves(figure: FigureBase, curves: Sequence[Curve]) -> None:
    """Draw the panels side by side: for each algorithm the line of its run, or the mean and band of several runs."""
    algorithms = list(dict.fromkeys(curve.algorithm for curve in curves))
    colours = name_colours(algorithms)
    axes = figure.subplots(1, len(PANELS))
    for ax, (key, label, logarithmic) in zip(axes, PANELS, strict=True):
        for name in algorithms:
            own = [curve for curve in curves if curve.algorithm == name]
            text = name if len(own) == 1 else f"{name} ({len(own)} runs)"
            _draw(ax, own, key, hexed(colours[name]), text)
        if logarithmic:
            log_scale(ax, [float(value) for curve in curves for value in curve.values[key]])
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
    """Return steps, lowest, mean and highest value of runs, each float64[T].

    A single run is returned as it is. Of several, each is interpolated and counts from its first to its last row.
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
