"""All studies, as `studies/*.toml` hold them, and the functions behind the names in these files.

A file has one study or several as [[studies]]; what stands above them is shared by all. A file without systems runs
every planner at its defaults.
"""

import tomllib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

from train.tables.papers import avoidance, coordinator, settings
from train.tables.study import Experiment, TableSetting, TableStudy
from warehouse_env.checked import from_plain
from warehouse_env.planning import PLANNERS

FOLDER = Path(__file__).parent / "studies"
PAPERS = ("000", "001", "002", "003", "004")

SETTINGS: dict[str, Callable[[], tuple[TableSetting, ...]]] = {made.__name__: made for made in (
    settings.clutter_and_blocks, settings.walker_floors, coordinator.six_agvs, avoidance.moving_obstacle,
    settings.traps_and_clutter, settings.more_clutter, settings.floors_of_references, settings.pairs_on_floors,
)} | {
    "in_zone": partial(settings.on_paper46, "in_zone_2", "in_zone_1", "in_zone_3", settings.PATH_4),  # as in table 1
    "cross_zone": partial(settings.on_paper46, "cross_zone_1", "cross_zone_2"),  # as in table 2
    # 30 x 30 cells with the start (1, 1) and goal (30, 28) of paper 002, counted from 1
    "paper002_floors": partial(settings.clutter, 30, (0.2, 0.3), 16, ((0, 0), (29, 27))),
    # the five environments of tables 2 and 3 of paper 004
    "shares_of_obstacles": lambda: settings.clutter(20, (0.2, 0.25, 0.3, 0.35), 8) + settings.clutter(30, (0.2,), 8),
}  # fmt: skip
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
