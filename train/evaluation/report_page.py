"""The report of an evaluation: a page with its table, charts, heat maps and worst episodes, from rows and notes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from train.evaluation.pictures import MEASURES, bars
from train.evaluation.places import KEY, PAGE, floor_of_notes
from train.evaluation.recorded import worst_episodes, write_replays
from train.evaluation.rollout import Experiment
from train.reporting.columns import labels
from train.reporting.page import Page, PagePart, Shown, made_by
from train.reporting.report import evaluation_table, grouped, make_progress, number
from train.reporting.rows import Row, select, short_names, values_of, write_rows
from warehouse_env.errors import counted
from warehouse_env.maps.fitting import load_floor
from warehouse_env.render.heat_maps import Panel, heat_maps
from warehouse_env.render.report_charts import over_robots

ROWS = "rows.jsonl"
WORST = 5  # episodes shown as replays
CAVEAT = "Brackets are 95% intervals, each for itself: one in twenty misses the true value."


def write_report(
    rows: Sequence[Row], shown: Sequence[Row], notes: Sequence[Row], experiments: Sequence[Experiment], folder: Path,
    rows_path: Path,
) -> Path:  # fmt: skip
    """Write the page, the replays beside it, and a copy of the rows if they are elsewhere; return the page.

    shown: the rows of table and charts, where groups stand for their trainings. notes: of all or some of the episodes;
    notes of other episodes and repeated ones are ignored.
    """
    known, noted = {values_of(row, KEY) for row in rows}, {values_of(note, KEY): note for note in notes}
    notes = [note for key, note in noted.items() if key in known]
    worst = worst_episodes(rows, WORST)
    with make_progress() as progress:
        bar = progress.add_task("replays of the worst episodes", total=len(worst))
        links = write_replays(worst, experiments, folder, lambda: progress.advance(bar))
    short = short_names({str(row["layout"]) for row in rows}) | labels(rows) | labels(shown)
    parts = [
        PagePart("Table", tables=[evaluation_table(shown)]),
        PagePart("Over the number of robots", pictures=_over_robots(shown, short)),
        _where(experiments, rows, notes, short),
        PagePart("Worst episodes", _WORST, links=links),
        PagePart("What was run", facts=_facts(rows, notes)),
    ]
    if rows_path.absolute() != (folder / ROWS).absolute():
        write_rows(folder / ROWS, rows)
    title = f"Evaluation: {', '.join(dict.fromkeys(short[str(row['policy'])] for row in rows))}"
    places = ", ".join(dict.fromkeys(short[str(row["layout"])] for row in rows))
    subtitle = f"{places}; {rows[0]['tasks']} tasks, routes by {rows[0]['planner']}"
    Page(title, subtitle, [CAVEAT], parts).write(folder / PAGE)
    return folder / PAGE


_WORST = (
    "The worst episode of each policy, then the second worst of each: by collisions per km, then by robots stuck at "
    "the end, then by the longest standing. Each opens as a replay; the .npz file beside it plays it again to the bit."
)


# Charts over the number of robots: label, what is better, and the measures by their titles.
_CHARTS = (
    (
        "Collisions per robot-km and goals per robot-hour over the number of robots",
        "Fewer collisions and more goals are better.",
        MEASURES,
    ),
    (
        "Orders per hour of all robots, and late orders, over the number of robots",
        "More orders, and fewer late ones, are better.",
        {"orders an hour": "orders_per_hour", "late orders": "orders_late"},
    ),
)


def _over_robots(rows: Sequence[Row], short: Mapping[str, str]) -> list[Shown]:
    """Return the charts of _CHARTS for which there are rows."""
    pictures = []
    for label, better, measures in _CHARTS:
        known = [row for row in rows if set(measures.values()) <= row.keys()]
        floors = {
            short[str(layout)]: {title: bars(own, name, short) for title, name in measures.items()}
            for (layout,), own in grouped(known, ("layout",)).items()
        }
        if floors:
            caption = f"{label}: means over episodes with 95% intervals. {better}"
            pictures.append(Shown(over_robots(floors, label), caption))
    return pictures


def _where(
    experiments: Sequence[Experiment], rows: Sequence[Row], notes: Sequence[Row], short: Mapping[str, str]
) -> PagePart:
    """Return the heat maps of each floor with the most robots there, a panel a policy."""
    grids = {one.config.layout: load_floor(one.config) for one in experiments}
    pictures = []
    for (layout,), own in grouped(rows, ("layout",)).items():
        robots = max(row["robots"] for row in own)
        noted = grouped(select(notes, layout=layout, robots=robots), ("policy",))
        floors = {short[str(policy)]: floor_of_notes(some) for (policy,), some in noted.items()}
        if not floors:
            continue
        label = f"Where robots wait and collide on {short[str(layout)]} with {counted(robots, 'robot')}"
        hours = number(sum(floor.hours for floor in floors.values()) / len(floors), 2)
        caption = (
            f"{label}: the colour is the seconds per hour that a robot's centre stands on a cell, red crosses are "
            f"collisions in {hours} simulated hours per policy, blue squares are stations."
        )
        panels = [Panel(name, grids[str(layout)], floor.waiting, floor.contacts) for name, floor in floors.items()]
        pictures.append(Shown(heat_maps(panels, "standing [s per hour]", label), caption))
    missing = "" if pictures else "No places were noted: the rows were kept from a run without a report."
    return PagePart("Where robots wait and collide", missing, pictures)


def _facts(rows: Sequence[Row], notes: Sequence[Row]) -> dict[str, str]:
    seeds = sorted({row["seed"] for row in rows})
    shown = f"{seeds[0]} to {seeds[-1]}" if seeds[-1] - seeds[0] + 1 == len(seeds) > 1 else ", ".join(map(str, seeds))
    hours = sum(row["seconds"] for row in rows) / 3600
    km = sum(row["robot_km"] for row in rows)
    return made_by(**{
        "Seeds": f"{shown}, the same for every policy",
        "Simulated": f"{len(rows)} episodes, {number(hours)} hours, {number(km)} robot-km",
        "Places noted": f"in {len(notes)} of {len(rows)} episodes",
        "Rows": f"`{ROWS}` beside this page holds every episode with its whole configuration",
    })  # fmt: skip
