"""What a policy is likely to do, drawn on the floor: heat maps of chances, and robots in the colour of their chance."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.chart_style import FAINT, INK, draw_discs, empty_figure, hexed, save, style
from warehouse_env.render.colours import CONTACT, GREY
from warehouse_env.render.extras import load
from warehouse_env.render.floor import FLOOR
from warehouse_env.render.sprites import rounded_box

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

Numbers = NDArray[np.floating[Any]]

HEAT = "viridis"  # dark is 0, bright is 1, in grey as well
_WIDE = 11.0  # [inches] of a picture
_ARROW = 1.0  # [s] of driving that an arrow is long
SHELF = (176, 183, 193)
MAP_LEGEND = (
    "colour: what the robot does next if its front axle is there and it drives along its route (dashed)    "
    "red: the others, arrows: their way in one second"
)
MOMENTS_LEGEND = "arrows: way in one second    pale: has arrived, parked"
_STANDS = 0.05  # [m/s] under which it is left out


class View(NamedTuple):
    """A part of the floor [m]."""

    left: float
    right: float
    low: float
    high: float

    def points(self, along: float, across: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x float64[C] and y float64[R] of a lattice whose cells, `along` x `across` [m], fill the view."""
        columns, rows = round((self.right - self.left) / along), round((self.high - self.low) / across)
        x, y = (np.arange(count, dtype=np.float64) + 0.5 for count in (columns, rows))
        return self.left + along * x, self.low + across * y


class ProbabilityMap(NamedTuple):
    """Chances of one robot at every point of a lattice, and the other robots that it sees from there."""

    grid: GridMap
    robot: RobotSpec
    x: Numbers  # [C], of the front axle [m], evenly spaced
    y: Numbers  # [R]
    heading: Numbers  # [R, C], of the robot there [rad]
    chances: dict[str, Numbers]  # what it may do -> [R, C] in [0, 1]; nan where it cannot be
    pose: Numbers  # [K, 3] of the others, front axle x [m], y [m], heading [rad]
    speed: Numbers  # [K] of the others [m/s]
    route: Numbers  # [L, 2] of the one robot [m]
    view: View


class Moments(NamedTuple):
    """M moments of N robots, and how likely each is to drive on."""

    grid: GridMap
    robot: RobotSpec
    seconds: Numbers  # [M]
    pose: Numbers  # [M, N, 3]
    speed: Numbers  # [M, N]
    chance: Numbers  # [M, N]
    alive: NDArray[np.bool_]  # [M, N], False: parked
    view: View


def probability_maps(one: ProbabilityMap, title: str, path: str | os.PathLike[str]) -> None:
    """Write a heat map for each of the chances, two beside each other."""
    with style():
        rows = math.ceil(len(one.chances) / 2)
        figure = empty_figure(_WIDE, 0.9 + rows * (0.55 + 0.42 * _WIDE * _ratio(one.view)))
        axes = figure.subplots(rows, 2, squeeze=False).ravel().tolist()
        for ax in axes[len(one.chances) :]:
            ax.set_axis_off()
        draw_chances(axes, one)
        colour_bar(figure, axes, "chance", pad=0.01, aspect=25)
        figure.supxlabel(MAP_LEGEND, fontsize=9, color=FAINT)
        figure.suptitle(title, fontsize=12, x=0.01, ha="left")
        save(figure, path)


def draw_chances(axes: Sequence[Axes], one: ProbabilityMap) -> None:
    """Draw each of the chances into axes of its own."""
    dx, dy = (float(values[1] - values[0]) for values in (one.x, one.y))
    extent = (one.x[0] - dx / 2, one.x[-1] + dx / 2, one.y[0] - dy / 2, one.y[-1] + dy / 2)
    for ax, (name, chance) in zip(axes, one.chances.items(), strict=False):
        _draw_floor(ax, one.grid, one.view, 8)
        ax.imshow(
            np.ma.masked_invalid(chance), origin="lower", extent=extent, cmap=HEAT, vmin=0, vmax=1,
            interpolation="nearest", zorder=2,
        )  # fmt: skip
        ax.set_title(name)
        ax.plot(one.route[:, 0], one.route[:, 1], color="white", lw=2.2, zorder=3)
        ax.plot(one.route[:, 0], one.route[:, 1], color=INK, lw=1.0, ls=(0, (4, 2)), zorder=3)
        for pose, speed in zip(one.pose, one.speed, strict=True):
            draw_robot(ax, pose, float(speed), one.robot, hexed(CONTACT))


def moments(one: Moments, title: str, path: str | os.PathLike[str]) -> None:
    """Write the moments beside each other, every robot in the colour of its chance to drive on."""
    with style():
        count = len(one.seconds)
        columns = count if _ratio(one.view) > 0.6 else 2 if _ratio(one.view) > 0.3 else 1
        rows = math.ceil(count / columns)
        figure = empty_figure(_WIDE, 1.0 + rows * (0.5 + 0.85 * _WIDE / columns * _ratio(one.view)))
        axes = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
        draw_moments(axes, one)
        colour_bar(figure, axes, "chance to drive on", pad=0.01, aspect=25)
        figure.supxlabel(MOMENTS_LEGEND, fontsize=9, color=FAINT)
        figure.suptitle(title, fontsize=12, x=0.01, ha="left")
        save(figure, path)


def draw_moments(axes: Sequence[Axes], one: Moments) -> None:
    """Draw each moment into axes of its own."""
    shades = load("matplotlib.cm").ScalarMappable(load("matplotlib.colors").Normalize(0, 1), HEAT)
    for k, ax in enumerate(axes):
        _draw_floor(ax, one.grid, one.view, 5)
        for pose, speed, chance, alive in zip(one.pose[k], one.speed[k], one.chance[k], one.alive[k], strict=True):
            colour = shades.to_rgba(float(chance)) if alive else hexed(GREY)
            draw_robot(ax, pose, float(speed), one.robot, colour, 1.0 if alive else 0.35)
        ax.set_title(f"after {one.seconds[k]:.1f} s")


def draw_robot(ax: Axes, pose: Numbers, speed: float, robot: RobotSpec, colour: Any, alpha: float = 1.0) -> None:
    """Draw a body with its nose, and an arrow as long as it drives in a second, backwards where it backs."""
    x, y, heading = (float(value) for value in pose)
    cos, sin = math.cos(heading), math.sin(heading)
    turn = np.array([[cos, sin], [-sin, cos]])  # turns row vectors
    half = robot.width / 2
    body = rounded_box(-robot.rear_reach, robot.front_overhang, -half, half, 0.12) @ turn + (x, y)
    ax.fill(body[:, 0], body[:, 1], fc=colour, ec=INK, lw=0.8, alpha=alpha, zorder=5)
    nose = np.array([(robot.front_overhang - 0.04, 0.0), (-0.16, 0.7 * half), (-0.16, -0.7 * half)]) @ turn + (x, y)
    ax.fill(nose[:, 0], nose[:, 1], fc="white", ec=INK, lw=0.5, alpha=alpha, zorder=6)
    if abs(speed) >= _STANDS:
        begin = robot.front_overhang if speed > 0 else -robot.rear_reach
        end = begin + _ARROW * speed
        arrow = ax.annotate(
            "", (x + end * cos, y + end * sin), (x + begin * cos, y + begin * sin), zorder=7,
            arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7},
        )  # fmt: skip
        outlined = load("matplotlib.patheffects").withStroke(linewidth=2.6, foreground="white")
        assert arrow.arrow_patch is not None
        arrow.arrow_patch.set_path_effects([outlined])


def _ratio(view: View) -> float:
    return (view.high - view.low) / (view.right - view.left)


def _draw_floor(ax: Axes, grid: GridMap, view: View, most: int) -> None:
    """Draw floor and shelves in plain colours, so that what is laid over them stands out, and `most` ticks a side."""
    height, width = (grid.cell_size * count for count in grid.shape)
    plain = np.where(grid.walls[..., None], SHELF, FLOOR).astype(np.uint8)
    ax.imshow(plain, extent=(0, width, 0, height), interpolation="nearest")
    draw_discs(ax, grid, SHELF)
    ax.set(xlim=(view.left, view.right), ylim=(view.low, view.high))
    ticker = load("matplotlib.ticker")
    for axis, length in ((ax.xaxis, view.right - view.left), (ax.yaxis, view.high - view.low)):
        axis.set_major_locator(
            ticker.MultipleLocator(next(step for step in (1, 2, 4, 8, 16, length) if length <= most * step))
        )
        axis.set_major_formatter(ticker.FormatStrFormatter("%g m"))
    ax.tick_params(labelsize=8, labelcolor=FAINT)
    for side in ("top", "right"):
        ax.spines[side].set_visible(True)


def colour_bar(figure: FigureBase, axes: Sequence[Axes], label: str, **where: Any) -> None:
    """Draw what the colours mean beside the axes, or `where` matplotlib is told to."""
    shades = load("matplotlib.cm").ScalarMappable(load("matplotlib.colors").Normalize(0, 1), HEAT)
    percent = load("matplotlib.ticker").PercentFormatter(1.0)
    bar = figure.colorbar(shades, ax=list(axes), label=label, ticks=[0, 0.5, 1], format=percent, **where)
    bar.outline.set_visible(False)
