"""From rows to tables, as text and as Markdown. Pictures of an evaluation are in `train/evaluation/pictures.py`."""

import math
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table as RichTable

from train.reporting.columns import Measure, driven_with, field_of, measures_for, note_for, note_on_groups, who_stood
from train.reporting.rows import Interval, Row, short_names, values_of
from warehouse_env.render.chart_style import check_picture
from warehouse_env.render.extras import load

_NUMBER = re.compile(r"[-+]?\d")


@dataclass(frozen=True)
class Table:
    """A title, a heading for each column, rows of text, and a note below."""

    title: str
    header: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]
    note: str = ""

    def print(self, file: TextIO | None = None) -> None:
        """Print for reading, on stdout unless `file` is given; text columns to the left, numbers to the right.

        On a terminal that is too narrow for the table, text wraps; if that is not enough, every row becomes a list.
        """
        console = make_console(file or sys.stdout)
        shown = RichTable(title=self.title, title_justify="left", title_style="bold")
        for index, name in enumerate(self.header):
            cells, numeric = [row[index] for row in self.cells], self.numeric(index)
            pieces = [*name.split(), *(cells if numeric else " ".join(cells).split())]  # each on one line
            least = max(map(len, pieces), default=1)
            shown.add_column(
                name, justify="right" if numeric else "left", width=least if numeric else None, min_width=least,
                overflow="fold",
            )  # fmt: skip
        for row in self.cells:
            shown.add_row(*row)
        if sum(3 + (column.min_width or 0) for column in shown.columns) < console.width:
            console.print(shown)
        else:
            console.print(self.title, style="bold")
            for row in self.cells:
                console.print(*map(": ".join, zip(self.header, row, strict=True)), sep="\n", end="\n\n")
        if self.note:
            console.print(self.note)

    def markdown(self) -> str:
        """Return the table as Markdown."""
        rule = ["--:" if self.numeric(index) else "---" for index in range(len(self.header))]
        lines = [" | ".join(map(no_html, row)) for row in (self.header, rule, *self.cells)]
        body = "\n".join(f"| {line} |" for line in lines)
        note = "".join(f"\n{line.strip()}\n" for line in self.note.splitlines())
        return f"### {no_html(self.title)}\n\n{body}\n{note}"

    def numeric(self, index: int) -> bool:
        """Return whether a column holds numbers, which are read from the right."""
        return any(_NUMBER.match(row[index]) for row in self.cells)


def no_html(text: str) -> str:
    """Return text for a cell of a Markdown table, with HTML and cell separators escaped."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|")


def make_console(file: TextIO) -> Console:
    """Return a console on `file`: as wide as the terminal, endless where it is none, as tables go to files whole."""
    return Console(file=file, width=None if file.isatty() else sys.maxsize, markup=False, highlight=False)


def make_progress() -> Progress:
    """Return a progress bar on stderr, so that stdout stays clean for tables and pipes."""
    described, console = TextColumn("{task.description}"), Console(stderr=True)
    columns = (described, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console, disable=not console.is_terminal)


def tell(text: str, console: Console | None = None) -> None:
    """Print one line on stderr, above the progress bar of the console, if any."""
    (console or Console(stderr=True)).print(text, markup=False, highlight=False, soft_wrap=True)


def require_charts(picture: Path | None = None) -> None:
    """Raise WarehouseError if charts or this kind of picture cannot be drawn; asked before a long run."""
    load("matplotlib")
    if picture is not None:
        check_picture(picture)


def require_video() -> None:
    """Raise WarehouseError if no video can be made."""
    load("pygame")
    load("imageio_ffmpeg")


def number(value: float, digits: int = 3) -> str:
    """Format with `digits` significant digits and no exponent; "-" for NaN."""
    if not math.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text and abs(value - round(value)) < 1e-12 else text


def with_interval(interval: Interval, factor: float = 1.0, digits: int = 3) -> str:
    """Format "mean [low, high]", each times `factor`; the mean alone where there is no interval or no spread."""
    mean, low, high, _ = interval.times(factor)
    if not math.isfinite(low) or high - low <= 1e-9 * abs(mean):
        return number(mean, digits)
    decimals = max(0, digits - 1 - math.floor(math.log10(max(abs(mean), abs(low), abs(high)))))
    return f"{mean:.{decimals}f} [{low:.{decimals}f}, {high:.{decimals}f}]"


def difference(found: Interval, factor: float = 1.0, digits: int = 3) -> str:
    """Format a difference as `with_interval` does, with its sign."""
    text = with_interval(found, factor, digits)
    return f"+{text}" if found.mean > 0 else text


_GROUP = ("layout", "robots", "tasks", "planner", "policy")
FREE_FLOW = "free_flow_share"
_FREE_FLOW_NOTE = " Free flow: late goals/robot-h as a share of those of one robot alone with the same policy."


def grouped(rows: Iterable[Row], names: Sequence[str]) -> dict[tuple[object, ...], list[Row]]:
    """Split rows by the values of some fields, in the order of their first appearance."""
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(values_of(row, names), []).append(row)
    return groups


def summarise(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return for each layout, robot count, task mode, planner and policy its `Interval` of every measure."""
    summary: list[dict[str, Any]] = []
    for values, group in grouped(rows, _GROUP).items():
        intervals = {m.name: m.interval(group) for m in measures_for(rows)}
        summary.append({**dict(zip(_GROUP, values, strict=True)), "episodes": len(group), **intervals})
    shared = [name for name in _GROUP if name != "robots"]  # with a robot alone, whose goals are the free flow
    alone = {values_of(line, shared): line["late_goals_per_robot_hour"] for line in summary if line["robots"] == 1}
    for line in summary:
        if free := alone.get(values_of(line, shared)):
            line[FREE_FLOW] = _share(line["late_goals_per_robot_hour"], free)
    return summary


def _share(part: Interval, whole: Interval) -> Interval:
    """Return the ratio of two independent means with its 95% interval by the delta method."""
    if not whole.mean > 0:
        return Interval(math.nan, math.nan, math.nan, part.samples)
    ratio = part.mean / whole.mean
    half = math.hypot(part.high - part.mean, ratio * (whole.high - whole.mean)) / whole.mean
    return Interval(ratio, max(0.0, ratio - half), ratio + half, part.samples)


def evaluation_table(rows: Sequence[Row]) -> Table:
    """Return the table of an evaluation: one line for each layout, robot count and policy.

    With rows of one robot alone, the other rows show their share of its free flow.
    """
    constant = [name for name in ("tasks", "planner") if len({row[name] for row in rows}) == 1]
    names = [name for name in _GROUP if name not in constant]
    shown = [measure for measure in measures_for(rows) if measure.shown]
    summary = summarise(rows)
    flow = any(FREE_FLOW in line for line in summary)
    if flow:
        shown.insert(-1, Measure(FREE_FLOW, "free flow %", field_of(FREE_FLOW), factor=100.0))
    short = short_names({str(row[name]) for row in rows for name in names})
    cells = []
    for line in summary:
        texts = [with_interval(line[m.name], m.factor) if m.name in line else "-" for m in shown]
        cells.append((*(short[str(line[name])] for name in names), str(line["episodes"]), *texts))
    shared = ", ".join(f"{name} {rows[0][name]}" for name in constant)
    header = (*names, "episodes", *(m.heading for m in shown))
    note = driven_with(rows) + note_for(shown) + who_stood(rows) + note_on_groups(rows)
    note += _FREE_FLOW_NOTE if flow else ""
    return Table(f"Evaluation ({shared})" if shared else "Evaluation", header, tuple(cells), note)
