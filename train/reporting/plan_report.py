"""The table of `warehouse plan`, and the note that says plainly what the ants add to an exact search."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence

from train.reporting.report import Table, grouped, number, with_interval
from train.reporting.rows import Row, mean_interval

_OPTIMAL = 1e-9  # relative excess of a length that still counts as the optimum, for rounding
_HEADER = (
    "planner", "task", "success", "length [cells]", "optimum", "gap", "optimal", "turns", "fewest possible",
    "converged at", "median ms",
)  # fmt: skip


def is_optimal(row: Row) -> bool:
    """True where the run found a shortest path."""
    return row["gap"] is not None and row["gap"] < _OPTIMAL


def plan_table(rows: Sequence[Row], note: str = "") -> Table:
    """Return one line for each planner and task, means over its runs; a climb column where the floor is uneven."""
    uneven = any(row["climb_m"] for row in rows)
    cells = []
    for (planner, task), group in grouped(rows, ("planner", "task")).items():
        line = [
            str(planner), str(task), _share(row["success"] for row in group),
            with_interval(mean_interval(row["length"] for row in group), digits=5),
            number(group[0]["optimal_length"], 6), f"{number(round(100 * _mean(group, 'gap'), 7))}%",
            _share(is_optimal(row) for row in group), number(_mean(group, "turns")), str(group[0]["min_turns"]),
            number(_mean(group, "converged_at")), number(_median_ms(group), 2),
        ]  # fmt: skip
        cells.append((*line, number(_mean(group, "climb_m"))) if uneven else tuple(line))
    runs = len({row["run"] for row in rows})
    title = f"Planners on {rows[0]['layout']}, {runs} runs each: means [95% interval by Student's t over runs]"
    return Table(title, _HEADER + (("climb [m]",) if uneven else ()), tuple(cells), note)


def plan_note(rows: Sequence[Row]) -> str:
    """Say what the exact searches cost and find, and what every colony adds to them, in the figures of `rows`."""
    every = {str(planner): group for (planner,), group in grouped(rows, ("planner",)).items()}
    exact = {name: group for name, group in every.items() if name.partition(":")[0] in ("astar", "astar_turns")}
    lines = [
        f"{name} takes {number(_median_ms(group), 2)} ms and finds the shortest path in "
        f"{_share(map(is_optimal, group))} of its runs, one with the fewest possible turns in "
        f"{_share(map(_fewest, group))}."
        for name, group in exact.items()
    ]
    if lines:
        lines[0] = f"Plainly: {lines[0]}"
    for name, group in every.items():
        if any(row["iterations"] for row in group):
            lines += _colony(name, group, exact)
    return "\n".join(lines)


def _colony(planner: str, group: Sequence[Row], exact: dict[str, list[Row]]) -> list[str]:
    """Return the lines on one colony: its time and optimality, and what it adds to each exact search."""
    ms = _median_ms(group)
    shares = f"the shortest path in {_share(map(is_optimal, group))}, the fewest turns in {_share(map(_fewest, group))}"
    lines = [f"{planner} takes {number(ms, 2)} ms and finds {shares} of its runs."]
    for name, own in exact.items():
        times = number(ms / _median_ms(own), 2)
        lines.append(f"  Over {name}, which is {times} times as fast, it adds {_added(group, own)}.")
    return lines


def _added(group: Sequence[Row], exact: Sequence[Row]) -> str:
    """Return where the colony's mean path is better than the exact search's: turns and climb; "nothing" if nowhere."""
    better = [
        f"{what} ({number(_mean(group, name))} against {number(_mean(exact, name))} {unit} a path)"
        for what, name, unit in (("fewer turns", "turns", "turns"), ("a gentler floor", "climb_m", "m of climb"))
        if _mean(group, name) < _mean(exact, name) * (1 - _OPTIMAL)
    ]
    longer = _mean(group, "gap") - _mean(exact, "gap")
    cost = f" for paths {number(100 * longer, 2)}% longer" if better and longer > _OPTIMAL else ""
    return (" and ".join(better) or "nothing") + cost


def _fewest(row: Row) -> bool:
    return is_optimal(row) and bool(row["turns"] <= row["min_turns"])


def _share(values: Iterable[bool]) -> str:
    flags = list(values)
    return f"{number(100 * sum(flags) / len(flags))}%"


def _mean(rows: Sequence[Row], name: str) -> float:
    return mean_interval(row[name] for row in rows).mean


def _median_ms(rows: Sequence[Row]) -> float:
    return float(statistics.median(row["ms"] for row in rows))
