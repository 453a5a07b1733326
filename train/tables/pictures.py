"""The pictures of the tables: which rows go into which chart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.evaluation.pictures import file_name
from train.reporting.report import number
from train.reporting.rows import Row, mean_interval
from train.tables.all_planners import family
from train.tables.figures import Figures
from train.tables.study import Study
from warehouse_env.render import charts, planner_charts
from warehouse_env.render.colours import name_colours
from warehouse_env.render.planner_charts import Point

_MOST_SETTINGS = 4  # of which a study's pictures are drawn, where it names none


class Picture(NamedTuple):
    """A chart to be drawn: the function, its arguments, the file that it writes, and a line below it."""

    draw: Callable[..., None]
    arguments: tuple[Any, ...]
    path: Path
    caption: str


def study_pictures(study: Study, figures: Figures, folder: Path) -> list[Picture]:
    """Return the pictures of a study: for each pictured setting the paths on one of its maps, and the convergence."""
    pictures: list[Picture] = []
    colours = name_colours(system.label for system in study.systems)
    for setting in study.settings():
        if setting.name not in (study.pictured or figures.settings[:_MOST_SETTINGS]):
            continue
        every = {system.label: figures.tasks(setting.name, system.label) for system in study.systems}
        every = {label: tasks for label, tasks in every.items() if tasks}
        optima = [task[0]["optimal_length"] for task in next(iter(every.values()))]
        chosen = optima.index(max(optima))
        rows = {label: tasks[chosen] for label, tasks in every.items()}
        where = "" if len(optima) == 1 else ", on the task with the longest way"
        title = f"{study.name.replace('_', ' ')}: {setting.name}"
        best = {label: next((row for row in own if row.get("cells")), None) for label, own in rows.items()}
        if study.experiment is not None and not any(best.values()):
            continue  # what moves there is no single path
        ways = {label: _way(row) for label, row in best.items()}
        notes = {label: _note(row) for label, row in best.items() if row is not None}
        path = folder / f"{study.name}_paths_{file_name(setting.name)}.png"
        grid, caption = setting.tasks[chosen].grid, f"{setting.name}: each system's best run{where}"
        pictures.append(Picture(charts.paths, (grid, ways, title, path, notes, colours), path, caption))
        curves = {label: _curves(own) for label, own in rows.items() if any(row["curve"] for row in own)}
        if curves:
            path = folder / f"{study.name}_convergence_{file_name(setting.name)}.png"
            caption = f"{setting.name}: median of the runs{where}; 10th to 90th percentile shaded"
            pictures.append(Picture(charts.convergence, (curves, optima[chosen], path, title, colours), path, caption))
    return pictures


def _way(row: Row | None) -> NDArray[np.float64]:
    if row is None:
        return np.zeros((0, 2))
    return np.array(row["line"] or row["cells"], dtype=np.float64).reshape(-1, 2)


def _note(row: Row) -> str:
    length = f"{number(row['length'], 5)} cells, {row['turns']} turns"
    if row["line"] is None:
        return length
    return f"{number(row['line_length'], 5)} cells as a line, {row['line_turns']} turns"


def _curves(rows: Sequence[Row]) -> NDArray[np.float64]:
    """Return float64[runs, iterations] from the falls [iteration, length] of each run; inf before the first path.

    A run that stopped early keeps its best.
    """
    curves = np.full((len(rows), max(row["iterations"] for row in rows)), np.inf)
    for curve, row in zip(curves, rows, strict=True):
        for iteration, length in row["curve"]:
            curve[int(iteration) - 1 :] = length
    return curves


def points_of(study: Study, figures: Figures, settings: Sequence[str]) -> list[Point]:
    """Return each system of a study over some of its settings as a point of gap against time; a sample is a task."""
    points = []
    for system in study.systems:
        tasks = [rows for setting in settings for rows in figures.tasks(setting, system.label)]
        rows = [row for task in tasks for row in task]
        if not rows:
            continue
        gaps = [[row["gap"] for row in task if row["gap"] is not None] for task in tasks]
        gap = mean_interval(100 * float(np.mean(own)) for own in gaps if own)
        failed = 1.0 - float(np.mean([row["success"] for row in rows]))
        ms = float(np.median([row["cpu_ms"] for row in rows]))
        points.append(Point(system.label, family(system.planner), ms, gap.mean, gap.low, gap.high, failed))
    return points


def pareto_pictures(study: Study, figures: Figures, folder: Path) -> list[Picture]:
    """Return gap against time of all planners, over all maps together and map by map."""
    settings = figures.settings
    together = folder / f"{study.name}_pareto.png"
    apart = folder / f"{study.name}_pareto_by_map.png"
    title = "What a millisecond buys: all planners"
    panels = {setting: points_of(study, figures, [setting]) for setting in settings}
    one = {f"{', '.join(settings)} together": points_of(study, figures, settings)}
    caption = (
        "Lower left is better. Hollow: some runs found no path, and the gap is that of the others. Grey: what no "
        "planner without failures beats"
    )
    return [
        Picture(planner_charts.pareto, (one, together, title), together, caption),
        Picture(planner_charts.pareto, (panels, apart, title), apart, f"{caption}. Map by map"),
    ]
