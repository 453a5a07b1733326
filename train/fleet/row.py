"""Rows of a real fleet's figures, as those of an evaluation, and the table that holds them beside a simulated one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from train.fleet.driven import Driven
from train.reporting.report import Table, number
from train.reporting.rows import Row, plain
from warehouse_env import __version__
from warehouse_env.simulation.record.recording import Episode

UNTOLD = ("reroutes",)
"""Figures of an episode that no message tells."""
_COLUMNS = (
    ("seconds", "s"), ("robot_km", "km"), ("goals", "goals"), ("goals_per_robot_hour", "goals/robot-h"),
    ("waiting_share", "waiting %"), ("near_misses", "near misses"), ("collisions_robot", "contacts"),
    ("min_clearance_m", "least gap m"), ("path_length_ratio", "driven/planned"),
    ("longest_standing_s", "longest standing s"),
)  # fmt: skip
_NOTE = (
    "A fleet's figures are what its messages tell: goals are orders done (with work at their end, where any vehicle "
    "tells its actions), waiting is standing with an order to drive, gaps are of bodies at the positions said, planned "
    "is straight from node to node of an order as it was first seen. Contacts are overlaps, or errors that two "
    "vehicles side by side report; with shelves and people only what vehicles report. Nobody tells who waits for whom, "
    "what was planned anew, nor what happened between two positions."
)


def row_of(episode: Driven, source: str) -> Row:
    """Return the row of a fleet; what no message tells is None."""
    told = episode.row() | dict.fromkeys(UNTOLD, math.nan)
    return _row(episode, told, "fleet", source) | {"notes": list(episode.notes), "vehicles": list(episode.vehicles)}


def row_of_simulated(episode: Episode, source: str, moved: Callable[[], object]) -> Row:
    """Return the row of a recorded episode, which is run again; moved: called after each moment."""
    metrics: dict[str, float] = {}
    for step, simulator in enumerate(episode.replay()):
        moved()
        if step == len(episode.actions):
            metrics = simulator.episode_metrics(0)
    return _row(episode, metrics, episode.policy or "simulated", source)


def _row(episode: Episode, metrics: dict[str, float], policy: str, source: str) -> Row:
    config = episode.config
    about = {
        "policy": policy, "layout": config.layout, "robots": config.num_agents,
        "tasks": config.tasks, "planner": config.planner, "source": source, "seed": episode.seeds[0],
    }  # fmt: skip
    return dict(plain({**about, **metrics, "config": config.to_dict(), "version": __version__}))


def fleet_table(rows: Sequence[Row], notes: Sequence[str]) -> Table:
    """Return the table: a line for the fleet, and one for each episode beside it."""
    cells = []
    for row in rows:
        values = [row.get(name) for name, _ in _COLUMNS]
        scaled = [100 * value if name == "waiting_share" and value is not None else value
                  for value, (name, _) in zip(values, _COLUMNS, strict=True)]  # fmt: skip
        cells.append((row["policy"], str(row["robots"]), *("-" if v is None else number(v, 4) for v in scaled)))
    header = ("who", "robots", *(heading for _, heading in _COLUMNS))
    noted = "".join(f"\nNote: {note}." for note in notes)
    return Table("Fleet", header, tuple(cells), _NOTE + noted)
