"""`warehouse compare RUN RUN`: evaluations side by side, with paired differences -> a table, rows, a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from train.reporting.comparison import ComparedRun, Line, compare, comparison_table, read_runs
from train.reporting.page import Page, PagePart, Shown, made_by
from train.reporting.report import require_charts, short_names
from train.reporting.rows import RowFile
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError

_DRAWN = ("goals_per_robot_hour", "collisions_per_km", "waiting_share", "orders_per_hour", "order_median_s")


@dataclass(frozen=True)
class Compare(Checked):
    """Compare runs of `warehouse evaluate` with the first one, over the episodes that both have.

    Each policy is compared with itself in the other run; runs with a single policy each are compared as they are.
    Example: warehouse compare results/before results/after --html results/difference.html
    """

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Files of rows that `warehouse evaluate` wrote, or folders with rows.jsonl in them (as a report is)."""
    policy: tuple[str, ...] = ()
    """Compare only these policies (default: all)."""
    seed: tuple[int, ...] = ()
    """Compare only episodes of these seeds (default: all)."""
    json: Path | None = None
    """File for the figures, a row for each measure, pair and floor, as JSON lines."""
    html: Path | None = None
    """File for a page with a chart of the differences and the table."""

    def run(self) -> None:
        """Read all runs, print the table, write rows and page."""
        runs = [self._chosen(run) for run in read_runs(self.runs)]
        lines = compare(runs, self.policy)
        file = RowFile(self.json)
        if self.html is not None:
            require_charts()
        comparison_table(lines).print()
        file.add(line.row() for line in lines)
        wrote = [f"the figures to {self.json}"] * (self.json is not None)
        if self.html is not None:
            _page(lines, runs).write(self.html)
            wrote.append(f"the page to {self.html}")
        episodes = sum(line.difference.samples for line in lines if line.measure == lines[0].measure)
        print(f"wrote {' and '.join(wrote) or 'no file (--json and --html do)'}; compared {episodes} pairs of episodes")

    def _chosen(self, run: ComparedRun) -> ComparedRun:
        rows = [row for row in run.rows if not self.seed or row["seed"] in self.seed]
        if not rows:
            raise ConfigError(f"{run.path} has no episode with --seed {' '.join(map(str, self.seed))}")
        return run._replace(rows=rows)


def _page(lines: Sequence[Line], runs: Sequence[ComparedRun]) -> Page:
    table = comparison_table(lines)
    facts = {}
    for run in runs:
        versions = ", ".join(sorted({str(row.get("version", "unknown")) for row in run.rows}))
        facts[run.name] = f"`{run.path}`, {len(run.rows)} episodes, version {versions}"
    title = f"{' and '.join(run.name for run in runs[1:])} against {runs[0].name}"
    drawn = PagePart("Differences", pictures=[_drawing(lines)])
    parts = [drawn, PagePart("Every figure", tables=[table]), PagePart("What was compared", facts=made_by(**facts))]
    return Page(title, "Paired differences over the same episodes", parts=parts)


def _drawing(lines: Sequence[Line]) -> Shown:
    from warehouse_env.render.report_charts import Pair, differences

    short = short_names({name for line in lines for name in (line.layout, line.ours.policy)})
    panels: dict[str, list[Pair]] = {}
    for line in lines:
        if line.measure.name in _DRAWN:
            name = f"{line.ours.run}: {short[line.ours.policy]}, {short[line.layout]} {line.robots}"
            scaled = [line.measure.factor * value for value in line.difference[:3]]
            panels.setdefault(line.measure.heading, []).append(Pair(name, *scaled))
    label = "Paired differences from the run that is compared with"
    caption = f"{label}: mean and 95% interval; blue and filled where the interval leaves out 0, else grey."
    return Shown(differences(panels, label), caption)
