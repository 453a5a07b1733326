"""All studies, as `studies/*.toml` hold them, and the functions behind the names in these files.

A file has one study or several as [[studies]]; what stands above them is shared by all. A file without systems runs
every planner at its defaults.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

from train.tables.papers import avoidance, coordinator, settings
from train.tables.papers.settings import pairs_on_floors
from train.tables.study import Experiment, TableSetting, TableStudy
from warehouse_env.checked import from_plain
from warehouse_env.planning import PLANNERS

FOLDER = Path(__file__).parent / "studies"
PAPERS = ("000", "001", "002", "003", "004")

SETTINGS: dict[str, Callable[[], tuple[TableSetting, ...]]] = {
    "in_zone": settings.in_zone,
    "cross_zone": settings.cross_zone,
    "clutter_and_blocks": settings.clutter_and_blocks,
    "walker_floors": settings.walker_floors,
    "six_agvs": coordinator.six_agvs,
    "paper002_floors": settings.paper002_floors,
    "moving_obstacle": avoidance.settings,
    "traps_and_clutter": settings.traps_and_clutter,
    "more_clutter": settings.more_clutter,
    "floors_of_references": settings.floors_of_references,
    "shares_of_obstacles": settings.shares_of_obstacles,
    "pairs_on_floors": pairs_on_floors,
}
EXPERIMENTS: dict[str, Experiment] = {
    "each alone": coordinator.on_grid,
    "coordinator": partial(coordinator.on_grid, aside=True, new_route=True),
    "no step aside": partial(coordinator.on_grid, aside=False, new_route=True),
    "no new route": partial(coordinator.on_grid, aside=True, new_route=False),
    **{name: partial(avoidance.avoid, answer=answer) for name, answer in avoidance.ANSWERS.items()},
}


@cache
def studies_of(file: str) -> dict[str, TableStudy]:
    """Return the studies of a file of FOLDER by name; ConfigError for a wrong one."""
    shared = tomllib.loads((FOLDER / f"{file}.toml").read_text(encoding="utf-8"))
    shared.setdefault("systems", [{"label": name, "planner": name} for name in PLANNERS])
    studies = [from_plain(TableStudy, {**shared, **own}) for own in shared.pop("studies")]
    return {study.name: study for study in studies}


@cache
def settings_of(file: str, study: str) -> dict[str, TableSetting]:
    """Return the settings of a study by name, built once in a process."""
    return {setting.name: setting for setting in SETTINGS[studies_of(file)[study].settings]()}
