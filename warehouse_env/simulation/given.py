"""Check the arguments of a Simulator besides its config."""

import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, shown
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.routes.book import RouteBook

Seeds = int | Sequence[int] | None  # of a Simulator's reset, which tells what they mean
_MOST_SAMPLES = 4096  # substeps of a full stop: minutes of braking


def check_parts(config: object, grid: object, planner: object, routes: object) -> None:
    """Raise ConfigError for a part of a wrong type; all but the config may be None."""
    for name, part, kind in (("config", config, EnvConfig), ("grid", grid, GridMap), ("routes", routes, RouteBook)):
        if not isinstance(part, kind) and (part is not None or name == "config"):
            raise ConfigError(f"{name}={shown(part)} must be of type {kind.__name__}")
    if planner is not None and not callable(getattr(planner, "plan", None)):
        raise ConfigError(f"planner={shown(planner)} must be a Planner")


def check_memory(config: EnvConfig, worlds: int, size: int, bytes_a_robot: int, cells: int) -> None:
    """Raise ConfigError if the worlds exceed the machine's memory; size: of an observation; cells: of the floor."""
    robots, people = config.num_agents, config.people
    needed = worlds * robots * (bytes_a_robot + 4 * (size + robots))  # an observation, and a stamp for every other
    needed += worlds * people * 4 * cells  # the ways to their goals
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > there:
        least = f"{min(needed // 10**9, 10**9):,} GB, but the machine has {there // 10**9:,}"
        raise ConfigError(
            f"num_worlds={shown(worlds)} of num_agents={robots} with observations of {size} numbers, and of "
            f"people={people}, need {least}; ask for less"
        )


def check_pace(config: EnvConfig, cell: float) -> None:
    """Raise ConfigError for robots that could jump over a shelf or the rim between two contact checks."""
    for robot in config.bodies:
        distance = max(robot.max_speed, -robot.min_speed) * config.time_step / config.substeps  # [m]
        turn = distance * math.tan(robot.max_steering) / robot.wheelbase  # [rad]
        tail = math.hypot(distance, turn * (robot.rear_reach - robot.length / 2))  # [m] that the body's centre moves
        if tail > cell or turn > math.pi:
            raise ConfigError(
                f"robots could move {tail:.3g} m and turn {turn:.3g} rad between two contact checks, more than a cell "
                f"of {cell:g} m or half a turn; use a shorter time_step, more substeps, or slower robots"
            )


def check_stop(config: EnvConfig, samples: int) -> None:
    """Raise ConfigError if the shield would check too many substeps of each stop."""
    if config.traffic_spec.shield and samples > _MOST_SAMPLES:
        hardest = min(robot.max_acceleration for robot in config.bodies)
        raise ConfigError(
            f"max_acceleration={hardest:g} makes a full stop last {samples} substeps, and "
            f"the shield looks at {_MOST_SAMPLES} at most; brake harder, or use fewer substeps"
        )


def listed(values: object) -> list[Any] | None:
    """Return the entries of a list, tuple or flat array, None for anything else."""
    if isinstance(values, np.ndarray):
        return list(values) if values.ndim == 1 else None
    return list(values) if isinstance(values, Sequence) and not isinstance(values, (str, bytes)) else None


def seeds_of(seed: object, worlds: int) -> list[list[int]] | list[None]:
    """Return each world's entropy, or None for each (see Simulator.reset); ConfigError for a bad seed."""
    if seed is None:
        return [None] * worlds
    given = listed(seed)
    if given is None:
        return [[whole_seed(seed), world] for world in range(worlds)]
    if len(given) != worlds:
        raise ConfigError(f"seed has {len(given)} entries for {worlds} worlds; give one for each")
    return [[whole_seed(one), 0] for one in given]


def whole_seed(seed: object) -> int:
    """Return a seed as a Python int; ConfigError unless it is a whole number of at least 0."""
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ConfigError(f"seed={shown(seed)} must be a whole number, not negative")
    return int(seed)
