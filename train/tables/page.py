"""The written tables: a page, a CSV file and pictures for each study, and an index with all verdicts."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.evaluation.pictures import file_name
from train.reporting.report import Table, number, with_interval
from train.reporting.rows import Row
from train.tables.measures import MEASURES, Figures
from train.tables.study import Claim, Published, Study, Verdict
from train.tables.verdicts import RULE, judge, verdict_counts
from warehouse_env import __version__
from warehouse_env.files import write_text
from warehouse_env.render import charts
from warehouse_env.render.colours import name_colours

INTERVALS = (
    "Means with their 95% intervals: by Student's t over runs where a setting is one map, over maps where it has "
    "several, cut to what is possible; shares on one map by Wilson's score. n: runs of each system, times maps. "
    "Lengths in cells, times in milliseconds of processor time, the median, with no compilation in it. Lines in "
    "italics are what the paper prints."
)


class Written(NamedTuple):
    """A study with what is said of it."""

    study: Study
    figures: Figures
    verdicts: list[tuple[Claim, Verdict]]
    pictures: list[Picture]


def write_pages(
    studies: Sequence[Study], rows: Sequence[Row], before: Sequence[tuple[Study, list[Row]]], folder: Path, *,
    pictures: bool,
) -> None:  # fmt: skip
    """Write the pages, tables and pictures of studies into a folder, and an index.

    before: studies whose pages are there already, with their rows; the index lists them too.
    """
    written = [_written(study, rows, folder, pictures) for study in studies]
    charts = [picture for one in written for picture in one.pictures]
    for chart in charts:
        chart.draw(*chart.arguments)
    for one in written:
        write_text(folder / f"{one.study.name}.md", _page(one))
        write_text(folder / f"{one.study.name}.csv", _csv(one))
    every = [*written, *(_written(study, own, folder, pictures) for study, own in before)]
    write_text(folder / "README.md", _index(sorted(every, key=lambda one: one.study.name)))


def _written(study: Study, rows: Sequence[Row], folder: Path, pictures: bool) -> Written:
    figures = Figures(study.name, rows)
    drawn = study_pictures(study, figures, folder) if pictures else []
    return Written(study, figures, [(claim, judge(figures, claim)) for claim in study.claims], drawn)


def study_table(study: Study, figures: Figures) -> Table:
    """Return a study's table: for each setting our systems, each with the printed lines that stand beside it."""
    lines: list[tuple[str, ...]] = []
    for setting in figures.settings:
        begin = len(lines)
        printed = [one for one in study.published if one.setting == setting]
        for system in study.systems:
            tasks = figures.tasks(setting, system.label)
            if not tasks:
                continue
            count = f"{len(tasks[0])}" if len(tasks) == 1 else f"{len(tasks[0])} x {len(tasks)}"
            found = ((figures.figure(setting, system.label, name), MEASURES[name]) for name in study.measures)
            texts = (with_interval(interval, measure.factor, measure.digits) for interval, measure in found)
            lines.append(("", system.label, count, *texts))
            lines += _printed_lines([one for one in printed if one.ours == system.label], study.measures)
        lines += _printed_lines([one for one in printed if not one.ours], study.measures)
        if len(lines) > begin:
            lines[begin] = (_named(study, figures, setting), *lines[begin][1:])
    header = ("setting", "system", "n", *(MEASURES[measure].heading for measure in study.measures))
    return Table(study.title, header, tuple(lines))


def _named(study: Study, figures: Figures, setting: str) -> str:
    """Return a setting's name with the optimum: of its map, or the mean of its maps."""
    label = study.systems[0].label
    optimum, fewest = (figures.figure(setting, label, name).mean for name in ("optimum", "min_turns"))
    return f"**{setting}** (optimum {number(optimum, 6)}, {number(fewest, 3)} turns)"


def _printed_lines(printed: Sequence[Published], measures: Sequence[str]) -> list[tuple[str, ...]]:
    """Return one line for each system in print, in italics."""
    lines = []
    for name in dict.fromkeys(one.system for one in printed):
        own = {one.measure: one.value for one in printed if one.system == name}
        known = {measure: MEASURES[measure] for measure in measures}
        texts = [f"*{number(own[k] * one.factor, one.digits)}*" if k in own else "" for k, one in known.items()]
        lines.append(("", f"*in print: {name}*", "", *texts))
    return lines


def _page(one: Written) -> str:
    table = study_table(one.study, one.figures).markdown().split("\n", 2)[2]  # without its title
    parts = [f"# {one.study.title}\n", f"{one.study.paper}.\n", table, f"{INTERVALS} {one.study.note}\n"]
    if one.verdicts:
        parts += ["## Claims\n", _claims(one.verdicts), f"{RULE}\n"]
    if one.pictures:
        parts.append("## Pictures\n")
        parts += [f"![{picture.caption}]({picture.path.name})\n\n{picture.caption}.\n" for picture in one.pictures]
    return "\n".join(parts)


def _claims(verdicts: Sequence[tuple[Claim, Verdict]]) -> str:
    lines = [f"| {verdict.shown} | {claim.text} | {verdict.why} |" for claim, verdict in verdicts]
    return "\n".join(["| verdict | claim | ours |", "| --- | --- | --- |", *lines]) + "\n"


def _csv(one: Written) -> str:
    """Return all figures, ours and printed, one a line; lengths in cells, times in ms, shares from 0 to 1."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("setting", "system", "source", "measure", "mean", "low95", "high95", "samples"))
    measures = dict.fromkeys((*one.study.measures, "found_share", "optimum", "min_turns"))
    for setting in one.figures.settings:
        for system in one.study.systems:
            for measure in measures:
                found = one.figures.figure(setting, system.label, measure)
                if math.isfinite(found.mean):
                    limits = [value if math.isfinite(value) else "" for value in (found.low, found.high)]
                    writer.writerow((setting, system.label, "ours", measure, found.mean, *limits, found.samples))
    for line in one.study.published:
        writer.writerow((line.setting, line.system, "paper", line.measure, line.value, "", "", ""))
    return text.getvalue()


def _index(written: Sequence[Written]) -> str:
    """Return the first page: every verdict, and where the tables are."""
    parts = ["# The papers' tables, made again\n"]
    parts.append(f"Made by `warehouse tables papers`, version {__version__}, from fixed seeds. {INTERVALS}\n")
    verdicts = [verdict for one in written for _, verdict in one.verdicts]
    if verdicts:
        parts += ["## The papers' claims\n", f"{verdict_counts(verdicts)} {RULE}\n"]
        parts.append("| table | claim | verdict |\n| --- | --- | --- |")
        parts += [
            f"| [{one.study.name}]({one.study.name}.md) | {claim.text} | {verdict.shown} |"
            for one in written
            for claim, verdict in one.verdicts
        ]
    parts.append("\n## The tables\n")
    parts += [
        f"- [{one.study.title}]({one.study.name}.md), {one.study.paper} ([CSV]({one.study.name}.csv))"
        for one in written
    ]
    return "\n".join(parts) + "\n"


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
    return np.array([] if row is None else row["line"] or row["cells"], dtype=np.float64).reshape(-1, 2)


def _note(row: Row) -> str:
    length = f"{number(row['length'], 5)} cells, {row['turns']} turns"
    if row["line"] is None:
        return length
    return f"{number(row['line_length'], 5)} cells as a line, {row['line_turns']} turns"


def _curves(rows: Sequence[Row]) -> NDArray[np.float64]:
    """Return float64[runs, iterations] from each run's falls [iteration, length]; inf before, then the best so far."""
    curves = np.full((len(rows), max(row["iterations"] for row in rows)), np.inf)
    for curve, row in zip(curves, rows, strict=True):
        for iteration, length in row["curve"]:
            curve[int(iteration) - 1 :] = length
    return curves
