"""The table of the benchmark's cells, and what is impossible or not solved."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from train.reporting.report import Table, grouped, number, with_interval
from train.reporting.rows import Row, mean_interval, wilson_interval

_HEADER = (
    "floor", "obstacles", "robots", "instances", "impossible", "solved of the others", "makespan", "flowtime",
    "seconds", "most",
)  # fmt: skip
NOTE = (
    "solved: by the exact check, of the instances that are not impossible as stated [95% interval by Wilson's score]. "
    "makespan, flowtime: means over the solved ones, at unit speed. seconds: of one core."
)


def cells_table(rows: Sequence[Row]) -> Table:
    """Return one line for each cell of the benchmark."""
    ordered = sorted(rows, key=lambda row: (row["size"], row["obstacle"], row["agents"]))
    lines = [_line(group) for group in grouped(ordered, ("size", "obstacle", "agents")).values()]
    return Table("CL-MAPF, as stated", _HEADER, tuple(lines), NOTE)


def _line(group: Sequence[Row]) -> tuple[str, ...]:
    first = group[0]
    possible = [row for row in group if not row["impossible"]]
    solved = [row for row in possible if row["solved"]]
    share = with_interval(wilson_interval(len(solved), len(possible)), 100.0) + "%" if possible else "-"
    seconds = [row["seconds"] for row in possible if "seconds" in row]
    side, obstacles = f"{first['size']:g}", "yes" if first["obstacle"] else "none"
    return (
        f"{side} x {side}", obstacles, str(first["agents"]), str(len(group)), str(len(group) - len(possible)),
        f"{len(solved)}: {share}", _mean(solved, "makespan"), _mean(solved, "flowtime"),
        number(sum(seconds) / len(seconds), 2) if seconds else "-", number(max(seconds), 2) if seconds else "-",
    )  # fmt: skip


def _mean(rows: Iterable[Row], name: str) -> str:
    values = [row[name] for row in rows]
    return number(mean_interval(values).mean) if values else "-"


def impossible_lines(rows: Iterable[Row]) -> list[str]:
    """Return a sentence for each instance that is impossible as stated."""
    return [f"{row['instance']}: {row['impossible'][0]}" for row in rows if row["impossible"]]


def unsolved_lines(rows: Iterable[Row]) -> list[str]:
    """Return a sentence for each possible instance that is not solved."""
    return [f"{row['instance']}: {_why(row)}" for row in rows if not (row["solved"] or row["impossible"])]


def _why(row: Row) -> str:
    if row.get("faults"):
        more = f" (and {row['fault_count'] - 1} more)" if row["fault_count"] > 1 else ""
        return f"{row['faults'][0]}{more}"
    if row.get("stranded"):
        return f"no route for {', '.join(row['stranded'])} even alone"
    return f"{row['meeting']} pairs still meet" if "meeting" in row else "no solution"
