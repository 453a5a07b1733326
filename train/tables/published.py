"""The published lines of the tables, and where a run differs from them.

`python -m train.tables.published ROWS.jsonl ...` writes the published lines anew from finished runs.
"""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

from train.reporting.report import Table, with_interval
from train.reporting.rows import Interval, Row, read_rows, select, values_of, write_rows
from train.tables.catalogue import FOLDER, settings_of, studies_of
from train.tables.measures import MEASURES, TableFigures
from train.tables.study import TableStudy

PUBLISHED = Path(__file__).with_suffix(".jsonl")
_RUN = ("study", "setting", "number", "system", "run")
_ROOM = 2.0  # intervals of a difference: by chance about one figure in ten thousand is further away
NOTE = (
    "Same: all means are equal to six digits. Within: no further from the published mean than twice the 95% interval "
    "of the difference; outside: further. Best, longest and standard deviation of one map have no interval, nor have "
    "few runs without spread. Times are not compared. Equal seeds and numbers of runs give equal figures, but for the "
    "last bits of another machine's arithmetic."
)


def lines_of(study: TableStudy, rows: Sequence[Row]) -> list[Row]:
    """Return a row for each line of a study's table, with each figure as [mean, low, high], but no times."""
    figures, lines = TableFigures(study.name, rows), []
    names = [name for name in study.measures if not MEASURES[name].clock]
    for setting in figures.settings:
        for system in study.systems:
            if tasks := figures.tasks(setting, system.label):
                line = {"study": study.name, "setting": setting, "system": system.label, "maps": len(tasks)}
                found = {name: _rounded(figures.figure(setting, system.label, name)) for name in names}
                lines.append({**line, "runs": len(tasks[0]), "seed": tasks[0][0]["seed"], "figures": found})
    return lines


def _rounded(interval: Interval) -> list[float | None]:
    return [float(f"{value:.6g}") if math.isfinite(value) else None for value in interval[:3]]


def against_published(studies: Sequence[TableStudy], rows: Sequence[Row]) -> tuple[Table, bool]:
    """Return a table with each line's difference from the published one, and whether a figure lies outside."""
    known, cells, outside = read_rows(PUBLISHED), [], False
    for line in (line for study in studies for line in lines_of(study, rows)):
        place = {name: line[name] for name in ("study", "setting", "system")}
        differences = [found for one in select(known, **place) for found in _differences(line, one)]
        outside |= any(word == "outside" for _, word in differences)
        told = "; ".join(f"{text}: {word}" for text, word in differences)
        cells.append((*place.values(), told or ("same" if select(known, **place) else "not published")))
    return Table("Beside the published rows", ("table", "setting", "system", "ours"), tuple(cells), NOTE), outside


def _differences(ours: Row, published: Row) -> list[tuple[str, str]]:
    """Return the figures of a line that differ, in words, each with "within", "outside" or "no interval"."""
    found = []
    for name, values in ours["figures"].items():
        other = published["figures"].get(name, values)
        if values[0] != other[0]:
            both = [Interval(*(math.nan if one is None else one for one in each), 0) for each in (values, other)]  # type: ignore[call-arg, arg-type]
            measure = MEASURES[name]
            shown = " against ".join(with_interval(one, measure.factor, measure.digits) for one in both)
            found.append((f"{measure.heading} {shown}", _word(*both)))
    return found


def _word(ours: Interval, published: Interval) -> str:
    if math.isfinite(ours.mean) != math.isfinite(published.mean):
        return "outside"
    halves = [max(one.high - one.mean, one.mean - one.low) for one in (ours, published)]
    if not all(map(math.isfinite, halves)) or halves[0] == 0.0 < halves[1]:  # a few runs that happen to be equal
        return "no interval"
    return "within" if abs(ours.mean - published.mean) <= _ROOM * math.hypot(*halves) else "outside"


def publish(paths: Sequence[Path]) -> None:
    """Write the published lines anew from files of rows; tables that these lack keep their lines."""
    every = {values_of(row, _RUN): row for path in paths for row in read_rows(path)}  # the last of each run
    old, lines = read_rows(PUBLISHED) if PUBLISHED.exists() else [], []
    for file in sorted(path.stem for path in FOLDER.glob("*.toml")):
        for name, study in studies_of(file).items():
            order = list(settings_of(file, name))
            own = select(list(every.values()), study=name)
            own.sort(key=lambda row: (order.index(row["setting"]), row["number"], row["run"]))
            lines += lines_of(study, own) or select(old, study=name)
    write_rows(PUBLISHED, lines)
    print(f"wrote {PUBLISHED}")


if __name__ == "__main__":
    publish([Path(path) for path in sys.argv[1:]])
