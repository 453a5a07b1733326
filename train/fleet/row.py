"""Rows of a real fleet's figures, like those of an evaluation, and their table beside a simulated episode."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from train.fleet.driven import FleetEpisode
from train.reporting.report import Table, number
from train.reporting.rows import Row, plain
from warehouse_env import __version__
from warehouse_env.simulation.record.recording import Episode

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


def row_of(episode: Episode, source: str, moved: Callable[[], object] = lambda: None) -> Row:
    """Return the row of a real fleet, or of a recorded episode by running it again; moved: called after each moment.

    Reroutes of a fleet are None, since no message tells them.
    """
    for last in episode.replay():
        moved()
        simulator = last
    config = episode.config
    row = {
        "policy": episode.policy or "simulated", "layout": config.layout,
        "robots": config.num_agents, "tasks": config.tasks, "planner": config.planner, "source": source,
        "seed": episode.seeds[0], **simulator.episode_metrics(0), "config": config.to_dict(), "version": __version__,
    }  # fmt: skip
    if isinstance(episode, FleetEpisode):
        notes, vehicles = list(episode.notes), list(episode.vehicles)
        row |= {"policy": "fleet", "reroutes": math.nan, "notes": notes, "vehicles": vehicles}
    return dict(plain(row))


def fleet_table(rows: Sequence[Row], notes: Sequence[str]) -> Table:
    """Return the table: a line for the fleet, and one for each episode."""
    cells = []
    for row in rows:
        values = [row.get(name) for name, _ in _COLUMNS]
        scaled = [100 * value if name == "waiting_share" and value is not None else value
                  for value, (name, _) in zip(values, _COLUMNS, strict=True)]  # fmt: skip
        cells.append((row["policy"], str(row["robots"]), *("-" if v is None else number(v, 4) for v in scaled)))
    header = ("who", "robots", *(heading for _, heading in _COLUMNS))
    noted = "".join(f"\nNote: {note}." for note in notes)
    return Table("Fleet", header, tuple(cells), _NOTE + noted)
