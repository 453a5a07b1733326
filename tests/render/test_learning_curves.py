"""Learning curves show the values of the runs, one colour an algorithm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from warehouse_env.render.chart_style import hexed
from warehouse_env.render.colours import name_colours
from warehouse_env.render.learning_curves import PANELS, Curve, draw_curves, learning_curves, spread

figures = pytest.importorskip("matplotlib.figure")
GOALS = "goals_per_robot_hour"


def curve(algorithm: str, steps: list[float], goals: list[float]) -> Curve:
    values = {key: np.array(goals) for key, _, _ in PANELS}
    return Curve(algorithm, np.array(steps) * 1e6, values)


def test_two_runs_of_an_algorithm_make_a_band() -> None:
    steps, low, mean, high = spread([curve("a", [0, 4], [0, 40]), curve("a", [0, 2], [20, 20])], GOALS)
    shared = steps <= 2e6
    assert low[shared] == pytest.approx(np.minimum(10 * steps / 1e6, 20)[shared])
    assert mean[shared] == pytest.approx((5 * steps / 1e6 + 10)[shared])
    assert high[shared] == pytest.approx(20)
    for line in (low, mean, high):  # the second has ended
        assert line[~shared] == pytest.approx(10 * steps[~shared] / 1e6)
    alone = curve("a", [1, 2, 3], [1, np.nan, 3])
    assert np.array_equal(spread([alone], GOALS)[2], [1, np.nan, 3], equal_nan=True)


def test_lines_and_scales() -> None:
    figure = figures.Figure(layout="constrained")
    draw_curves(
        figure, [curve("ppo", [1, 2], [4, 8]), curve("reinforce", [1, 3], [2, 0]), curve("ppo", [1, 2], [6, 8])]
    )
    goals, collisions, entropy = figure.axes
    ppo, reinforce = goals.get_lines()
    assert reinforce.get_xydata().tolist() == [[1, 2], [3, 0]]
    assert ppo.get_ydata()[[0, -1]] == pytest.approx([5, 8])
    colours = name_colours(["ppo", "reinforce"])
    assert [line.get_color() for line in (ppo, reinforce)] == [hexed(colours["ppo"]), hexed(colours["reinforce"])]
    assert [ax.get_yscale() for ax in (goals, collisions, entropy)] == ["linear", "symlog", "linear"]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["ppo (2 runs)", "reinforce"]


def test_runs_without_figures_are_drawn(tmp_path: Path) -> None:
    learning_curves([curve("ppo", [1, 2], [np.nan, np.nan]), curve("ppo", [1], [0.0])], tmp_path / "c.png")
    assert (tmp_path / "c.png").read_bytes()[1:4] == b"PNG"
