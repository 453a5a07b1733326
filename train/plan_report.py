"""The table of `warehouse plan`, and the note that says plainly what the ants add to an exact search."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence

from train.report import Table, grouped, number, with_interval
from train.rows import Row, mean_interval, select

_OPTIMAL = 1e-9  # relative excess of a length that still counts as the optimum, for rounding
_HEADER = (
    "planner",
    "task",
    "success",
    "length [cells]",
    "optimum",
    "gap",
    "optimal",
    "turns",
    "fewest possible",
    "converged at",
    "median ms",
)


def is_optimal(row: Row) -> bool:
    """True where the run found a shortest path."""
    return row["gap"] is not None and row["gap"] < _OPTIMAL


def plan_table(rows: Sequence[Row], note: str = "") -> Table:
    """Return one line for each planner and task, means over its runs; a climb column where the floor is uneven."""
    uneven = any(row["climb_m"] for row in rows)
    cells = []
    for (planner, task), group in grouped(rows, ("planner", "task")).items():
        line = [
            str(planner),
            str(task),
            _share(row["success"] for row in group),
            with_interval(mean_interval(row["length"] for row in group), digits=5),
            number(group[0]["optimal_length"], 6),
            f"{number(100 * mean_interval(row['gap'] for row in group).mean)}%",
            _share(is_optimal(row) for row in group),
            with_interval(mean_interval(row["turns"] for row in group)),
            str(group[0]["min_turns"]),
            with_interval(mean_interval(row["converged_at"] for row in group)),
            number(statistics.median(row["ms"] for row in group), 2),
        ]
        cells.append((*line, number(mean_interval(row["climb_m"] for row in group).mean)) if uneven else tuple(line))
    first = rows[0]
    runs = len({row["run"] for row in rows})
    title = f"Planners on {first['layout']}, {runs} runs each, mean [95% interval by Student's t over runs]"
    return Table(title, _HEADER + (("climb [m]",) if uneven else ()), tuple(cells), note)


def _share(values: Iterable[bool]) -> str:
    flags = list(values)
    return f"{number(100 * sum(flags) / len(flags))}%"


def plan_note(rows: Sequence[Row]) -> str:
    """Say what the exact search costs and finds, and what every other planner adds to it, in the figures of `rows`."""
    exact = select(rows, planner="astar")
    if not exact:
        return ""
    ms = statistics.median(row["ms"] for row in exact)
    lines = [
        f"Plainly: A* finds the optimum in {_share(map(is_optimal, exact))} of its runs, in {number(ms, 2)} ms (median), "
        f"with the fewest possible turns in {_share(map(_fewest, exact))}."
    ]
    for planner in dict.fromkeys(row["planner"] for row in rows):
        group = select(rows, planner=planner)
        if planner != "astar" and any(row["iterations"] for row in group):
            lines.append(_added(planner, group, exact, ms))
    return "\n".join(lines)


def _added(planner: str, group: Sequence[Row], exact: Sequence[Row], exact_ms: float) -> str:
    """Return the sentence on one planner beside A*: time, optimality, turns, climb."""
    ms = statistics.median(row["ms"] for row in group)
    text = (
        f"{planner} takes {number(ms, 2)} ms, {number(ms / exact_ms, 2)} times as long, and finds the optimum in "
        f"{_share(map(is_optimal, group))}; what it adds: the fewest possible turns in {_share(map(_fewest, group))} "
        f"({number(_mean(group, 'turns'))} turns a path against {number(_mean(exact, 'turns'))})"
    )
    if any(row["climb_m"] for row in exact):
        text += f", {number(_mean(group, 'climb_m'))} m of climb a path against {number(_mean(exact, 'climb_m'))} m"
    return text + "."


def _fewest(row: Row) -> bool:
    return row["turns"] is not None and row["turns"] <= row["min_turns"]


def _mean(rows: Sequence[Row], name: str) -> float:
    return mean_interval(row[name] for row in rows).mean
