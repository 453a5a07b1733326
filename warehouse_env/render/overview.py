"""One picture of what was learned: chances in telling moments, a jam that dissolves, learning curves."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

from warehouse_env.render.chart_style import empty_figure, save, style
from warehouse_env.render.learning_curves import Curve, draw_curves
from warehouse_env.render.probability_maps import Moments, ProbabilityMap, colour_bar, draw_chances, draw_moments

_WIDTH, _DPI = 10.0, 92  # [inches], a small picture for a page
_TITLES, _CURVES = 0.64, 2.4  # [inches] above a row, of the curves


def overview(
    maps: Mapping[str, ProbabilityMap],
    jams: Mapping[str, Moments],
    curves: Sequence[Curve],
    title: str,
    path: str | os.PathLike[str],
) -> None:
    """Write a row of heat maps for each moment, one of moments for each jam, and the curves below, if there are any.

    maps, jams: by their titles.
    """
    rows: dict[str, ProbabilityMap | Moments] = {**maps, **jams}
    with style():
        ratios = [(one.view.high - one.view.low) / (one.view.right - one.view.left) for one in rows.values()]
        heights = [_TITLES + 0.25 * _WIDTH * ratio for ratio in ratios] + [_CURVES] * bool(curves)
        heights[len(rows) - 1] += 0.5  # of the colour bar
        figure = empty_figure(_WIDTH, sum(heights) + 0.3, _DPI)
        parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
        for number, (part, (name, one)) in enumerate(zip(parts, rows.items(), strict=False), start=1):
            part.suptitle(name, fontsize=10.5, x=0.01, ha="left", fontweight="bold")
            count = len(one.seconds) if isinstance(one, Moments) else len(one.chances)
            axes = part.subplots(1, count, squeeze=False)[0].tolist()
            if isinstance(one, Moments):
                draw_moments(axes, one)
            else:
                draw_chances(axes, one)
            for ax in axes:
                ax.set(xticks=[], yticks=[])
                ax.set_title(ax.get_title(loc="left"), fontsize=9, pad=4)
            if number == len(rows):
                label = "chance of what stands above; in a jam: to drive on"
                colour_bar(part, axes, label, location="bottom", shrink=0.5, aspect=45, pad=0.03)
        if curves:
            draw_curves(parts[-1], curves)
        figure.suptitle(title, fontsize=12, x=0.01, ha="left")
        save(figure, path)
