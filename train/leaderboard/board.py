"""The board: entries side by side, a table a track."""

from __future__ import annotations

from collections.abc import Sequence

from train.leaderboard.cases import CASES, TRACKS, Case
from train.leaderboard.entry import Entry
from train.reporting.report import Table, number, with_interval
from train.reporting.rows import Interval, Row, mean_interval, select, stratified_interval

NOTE = (
    "Goals per robot and hour in the second half of 600 s, when traffic is steady: the mean of the groups [95% "
    "interval by Student's t over episodes within them], then each group's; contacts of all episodes together, a pair "
    "counts once; stuck: share of robots that at the end have not come on for a minute; stood: the longest that any "
    "robot stayed within a metre."
)
_CONTACTS = ("collisions_robot", "collisions_shelf")


def board(entries: Sequence[Entry], cases: Sequence[Case] = CASES) -> list[Table]:
    """Return a table for each track, the entry with most goals first."""
    return [_table(track, entries, cases) for track in TRACKS]


def _table(track: str, entries: Sequence[Entry], cases: Sequence[Case]) -> Table:
    groups = dict.fromkeys(case.group for case in cases)
    lines = []
    for entry in entries:
        rows = select(entry.rows, track=track)
        if not rows:  # it is not made for this track
            continue
        by_group = [[_late(row) for row in rows if _group(row, cases) == group] for group in groups]
        lines.append((stratified_interval(by_group), entry, rows, [mean_interval(one).mean for one in by_group]))
    lines.sort(key=lambda line: -line[0].mean)
    header = ("policy", "goals/robot-h", *groups, "contacts/km", "stuck %", "stood s", "version")
    cells = tuple(_cells(*line) for line in lines)
    return Table(f"{track}: {TRACKS[track].summary}", header, cells, NOTE)


def _cells(goals: Interval, entry: Entry, rows: Sequence[Row], by_group: Sequence[float]) -> tuple[str, ...]:
    km = sum(row["robot_km"] for row in rows)
    contacts = sum(row[name] for row in rows for name in _CONTACTS)
    return (
        entry.policy, with_interval(goals), *map(number, by_group), number(contacts / km, 2) if km else "-",
        number(100 * mean_interval(row["stuck"] for row in rows).mean, 2),
        number(max(row["longest_standing_s"] for row in rows)), entry.version,
    )  # fmt: skip


def _late(row: Row) -> float:
    return float(row["late_goals_per_robot_hour"])


def _group(row: Row, cases: Sequence[Case]) -> str:
    return next(case.group for case in cases if (case.layout, case.robots) == (row["layout"], row["robots"]))
