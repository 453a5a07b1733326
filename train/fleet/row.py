"""The row of a real fleet's figures, like those of an evaluation, and its table."""

from __future__ import annotations

import math
from collections.abc import Callable

from train.fleet.driven import FleetEpisode
from train.reporting.report import Table, number
from train.reporting.rows import Row, plain
from warehouse_env import __version__

_COLUMNS = (
    ("seconds", "s"), ("robot_km", "km"), ("goals", "goals"), ("goals_per_robot_hour", "goals/robot-h"),
    ("waiting_share", "waiting %"), ("near_misses", "near misses"), ("collisions_robot", "contacts"),
    ("min_clearance_m", "least gap m"), ("path_length_ratio", "driven/planned"),
    ("longest_standing_s", "longest standing s"),
)  # fmt: skip
_NOTE = (
    "Figures of a fleet come from its messages. Goals are finished orders (only those with an action, if any vehicle "
    "reports actions). Waiting is standing with an order to drive. Gaps are between bodies at the reported positions. "
    "Planned lengths are straight from node to node of an order when first seen. Contacts between robots are overlaps, "
    "or errors that two adjacent vehicles report; contacts with shelves and people are only reported errors."
)


def row_of(episode: FleetEpisode, source: object, moved: Callable[[], object] = lambda: None) -> Row:
    """Return a fleet's row; moved: called after each moment. Reroutes are None, since no message tells them."""
    for last in episode.replay():
        moved()
        shown = last
    config = episode.config
    row = {
        "policy": "fleet", "layout": config.layout, "robots": config.num_agents, "tasks": config.tasks,
        "planner": config.planner, "source": str(source), "seed": episode.seeds[0], **shown.episode_metrics(0),
        "config": config.to_dict(), "version": __version__, "reroutes": math.nan, "notes": list(episode.notes),
        "vehicles": list(episode.vehicles),
    }  # fmt: skip
    return dict(plain(row))


def fleet_table(row: Row) -> Table:
    """Return the table of a fleet's figures, and notes on what they leave out."""
    values = ((row.get(name), 100.0 if name == "waiting_share" else 1.0) for name, _ in _COLUMNS)
    cells = tuple("-" if value is None else number(scale * value, 4) for value, scale in values)
    noted = "".join(f"\nNote: {note}." for note in row["notes"])
    header = ("robots", *(heading for _, heading in _COLUMNS))
    return Table("Fleet", header, ((str(row["robots"]), *cells),), _NOTE + noted)
