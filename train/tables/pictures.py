"""The pictures of the tables: which rows go into which chart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.evaluation.pictures import file_name
from train.reporting.report import number
from train.reporting.rows import Row
from train.tables.figures import Figures
from train.tables.study import Study
from warehouse_env.render import charts
from warehouse_env.render.colours import name_colours

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
