"""Pictures of results: which rows and plans go into which chart, under which file name."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from train.evaluation.planning_runs import PlanningRun
from train.reporting import columns
from train.reporting.columns import labels
from train.reporting.report import grouped, number
from train.reporting.rows import Row
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render import charts, report_charts
from warehouse_env.render.report_charts import Bar

_MOST_TASKS = 10  # of which pictures are drawn; a scenario file may hold thousands
MEASURES = {report_charts.COLLISIONS: "collisions_per_km", "goals per robot-hour": "goals_per_robot_hour"}


def evaluation_pictures(rows: Sequence[Row], folder: Path) -> None:
    """Write a chart for each floor, task mode and planner."""
    groups = grouped(rows, ("layout", "tasks", "planner"))
    names = labels(rows)
    for (layout, tasks, planner), group in groups.items():
        which = () if len(groups) == 1 else map(file_name, map(str, (layout, tasks, planner)))
        path = folder / f"{'_'.join(('collisions', *which))}.png"
        measures = {title: bars(group, name, names) for title, name in MEASURES.items()}
        report_charts.draw_over_robots({Path(str(layout)).stem: measures}, path)


def bars(rows: Sequence[Row], measure: str, short: Mapping[str, str]) -> list[Bar]:
    """Return the mean of a measure for each policy and number of robots; short: the names that are shown."""
    return [
        Bar(short[str(policy)], int(str(robots)), *columns.MEASURES[measure].interval(group)[:3])
        for (policy, robots), group in grouped(rows, ("policy", "robots")).items()
    ]


def plan_pictures(grid: GridMap, runs: Sequence[PlanningRun], folder: Path) -> None:
    """Write for each task the first run's path of every planner, and the convergence of all runs."""
    tasks = list(dict.fromkeys(run.task for run in runs))[:_MOST_TASKS]
    for task in tasks:
        every: dict[str, list[PlanningRun]] = {}
        for run in (run for run in runs if run.task == task):
            every.setdefault(run.planner, []).append(run)
        cells = {name: own[0].plan.cells for name, own in every.items()}
        found = {name: own[0].row for name, own in every.items() if own[0].row["success"]}
        notes = {name: f"{number(row['length'], 5)} cells, {row['turns']} turns" for name, row in found.items()}
        title = f"{task.name} on {grid.name}: {task.start} to {task.goal}"
        charts.paths(grid, cells, title, folder / f"paths_{file_name(task.name)}.png", notes)
        curves = {
            name: _side_by_side([run.plan.best_by_iteration for run in own])
            for name, own in every.items()
            if len(own[0].plan.best_by_iteration) and any(run.row["success"] for run in own)
        }
        if curves:
            path = folder / f"convergence_{file_name(task.name)}.png"
            charts.convergence(curves, task.optimal_length, path, f"Convergence on {task.name}, {grid.name}")


def _side_by_side(histories: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return float64[runs, iterations]; a run that stopped early keeps its best."""
    longest = max(map(len, histories))
    return np.stack([np.pad(history, (0, longest - len(history)), mode="edge") for history in histories])


def file_name(text: str) -> str:
    """Return `text`, a name or the path of a file, as a part of a file name."""
    return re.sub(r"[^A-Za-z0-9.-]+", "_", Path(text).name.removesuffix(".map")).strip("_") or "unnamed"
