"""The table of an audit, and a sentence for each fault."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from train.evaluation.audit.instants import OVERLAPS
from train.reporting.report import Table, grouped, number
from train.reporting.rows import Row, short_names
from warehouse_env.errors import counted

_GROUP = ("layout", "robots", "policy")
_COUNTS = (*(f"overlaps_{kind}" for kind in OVERLAPS), "limits", "jumps")
_UNITS = {"speed": "m/s", "acceleration": "m/s^2", "steering": "rad", "steering rate": "rad/s"}
NOTE = (
    "Overlaps at any instant, of bodies with each other, with shelves or the rim, and with people; limits: speed, "
    "acceleration, steering or its rate beyond the robot's; jumps: no motion leads from one pose to the next; closest: "
    "two bodies at any instant (- over 500 mm); other poses: recordings that this version does not drive again to the "
    "bit."
)


def faults_of(row: Row) -> int:
    """Return the number of faults in an audit's row."""
    return len(row["faults"]) + (row["differs_at"] is not None)


def audit_table(rows: Sequence[Row]) -> Table:
    """Return the table: a line for each layout, number of robots and policy, and one of all."""
    short = short_names({str(row[name]) for row in rows for name in ("layout", "policy")})
    lines = []
    for (layout, robots, policy), group in grouped(rows, _GROUP).items():
        lines.append((short[str(layout)], str(robots), short[str(policy)], *_figures(group)))
    if len(lines) > 1:
        lines.append(("all", "", "", *_figures(rows)))
    header = (
        *_GROUP, "episodes", "robot-km", "with robots", "with shelves", "with people", "limits", "jumps",
        "deepest mm", "closest mm", "other poses",
    )  # fmt: skip
    return Table("Audit", header, tuple(lines), NOTE)


def _figures(rows: Sequence[Row]) -> tuple[str, ...]:
    counts = (str(sum(row[name] for row in rows)) for name in _COUNTS)
    closest = [row["closest_m"] for row in rows if row["closest_m"] is not None]
    return (
        str(len(rows)), number(sum(row["robot_km"] for row in rows), 4), *counts,
        number(1000 * max(row["deepest_m"] for row in rows)), number(1000 * min(closest)) if closest else "-",
        str(sum(row["differs_at"] is not None for row in rows)),
    )  # fmt: skip


def sentences(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a sentence for each fault."""
    for row in rows:
        where = f"{Path(row['policy']).name} on {row['layout']}, {counted(row['robots'], 'robot')}, seed {row['seed']}"
        if row["differs_at"] is not None:
            yield f"{where}: at step {row['differs_at']} {row['episode']} has other poses than this version drives"
        yield from (f"{where}: {_sentence(fault)}" for fault in row["faults"])


def _sentence(fault: Row) -> str:
    kind, size = fault["kind"], fault["size"]
    at = f"in step {fault['step']} at ({fault['x']:.2f}, {fault['y']:.2f}) m"
    if kind == "jump":
        return f"robot {fault['robot']} jumps by {number(1000 * size)} mm {at}"
    if kind in OVERLAPS:
        other = "a shelf" if kind == "shelf" else f"{kind} {fault['other']}"
        return f"robot {fault['robot']} overlaps {other} by {number(1000 * size)} mm {fault['time']:.3f} s {at}"
    return f"robot {fault['robot']} is over its {kind} by {number(size)} {_UNITS[kind]} {at}"
