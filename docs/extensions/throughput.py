"""`make chart`: draw docs/throughput.svg from the stored rows of measured episodes.

Files of rows as arguments replace the stored ones: `python docs/extensions/throughput.py results/*/rows.jsonl`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib

matplotlib.use("Agg")
matplotlib.rcParams |= {"svg.hashsalt": "throughput", "svg.fonttype": "none", "font.family": "sans-serif"}

import matplotlib.pyplot as plt  # noqa: E402

from train.reporting.rows import mean_interval, read_rows  # noqa: E402

DOCS = Path(__file__).parents[1]
ROWS, PICTURE = DOCS / "measured" / "throughput.jsonl", DOCS / "throughput.svg"
KEPT = ("policy", "layout", "robots", "seed", "late_goals_per_robot_hour", "collisions_per_km")
FLOORS = ("paper46", "narrow")
_ROOM = 30  # goals per hour; a higher bar has room for its figure
# In the order of the bars; grey marks policies of others.
BARS = {
    "shielded": ("shielded\ntraffic assist", "#0072b2"),
    "busy": ("busy\ntraffic routes", "#0072b2"),
    "greedy": ("greedy\ntraffic rules", "#56a4d3"),
    "orca": ("ORCA\ntraffic routes", "#8c8c8c"),
    "rules": ("paper 001\ntraffic routes", "#8c8c8c"),
}


class Bar(NamedTuple):
    """Late goals per robot-hour, with a 95% interval, and collisions per kilometre."""

    mean: float
    low: float
    high: float
    collisions: float


def measured(policy: str, floor: str, robots: int) -> Bar:
    """Return the figures of a policy on a floor for a number of robots."""
    rows = [r for r in read_rows(ROWS) if (r["policy"], r["layout"], r["robots"]) == (policy, floor, robots)]
    mean, low, high, _ = mean_interval([row["late_goals_per_robot_hour"] for row in rows])
    return Bar(mean, low, high, sum(row["collisions_per_km"] for row in rows) / len(rows))


def _hits(bar: Bar) -> str:
    return "no collision" if bar.collisions == 0 else f"{bar.collisions:.2g} collisions\nper km"


def draw() -> None:
    """Draw the chart: bars for 32 robots, a line for the free flow of one robot."""
    figure, axes = plt.subplots(1, len(FLOORS), figsize=(10.6, 3.9), sharey=True, layout="constrained")
    for ax, floor in zip(axes, FLOORS, strict=True):
        bars = {policy: measured(policy, floor, 32) for policy in BARS}
        for place, (policy, bar) in enumerate(bars.items()):
            error = [[bar.mean - bar.low], [bar.high - bar.mean]]
            ax.bar(place, bar.mean, 0.68, color=BARS[policy][1], yerr=error, capsize=3, ecolor="#555555")
            inside = bar.mean > _ROOM
            where = (place, bar.low / 2 if inside else bar.high + 3)
            ax.annotate(f"{bar.mean:.0f}", where, ha="center", fontsize=13, color="white" if inside else "black")
        alone = measured("greedy", floor, 1).mean
        ax.axhline(alone, color="#d55e00", linestyle="--", linewidth=1.4)
        ax.annotate(f"one robot alone: {alone:.0f}", (len(BARS) - 0.6, alone + 3), ha="right", color="#d55e00")
        ax.set(title=f"floor {floor}, 32 robots", ylim=(0, 170))
        ax.set_xticks(range(len(BARS)), [f"{BARS[name][0]}\n{_hits(bar)}" for name, bar in bars.items()], fontsize=8)
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("goals per robot and hour")
    figure.savefig(PICTURE, metadata={"Date": None})


def keep(files: list[str]) -> None:
    """Store the drawn fields of evaluation rows."""
    rows: list[dict[str, Any]] = [row for file in files for row in read_rows(Path(file))]
    lines = [json.dumps({name: row[name] for name in KEPT}) for row in rows]
    ROWS.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:]:
        keep(sys.argv[1:])
    draw()
    print(f"wrote {PICTURE}")
