"""How adapters build Simulators from keyword arguments, and share their routes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from warehouse_env.config import EnvConfig, EnvOptions
from warehouse_env.errors import ConfigError, shown
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.plan import Planner
from warehouse_env.simulation.simulator import Simulator

Made = TypeVar("Made")


class WorldOptions(EnvOptions, total=False):
    """Keyword arguments of every env of one world."""

    render_mode: str | None  # "rgb_array", "human" or None
    grid: GridMap | None  # instead of the layout that the config names
    planner: Planner | str | None  # an object, or a name of PLANNERS


def build_simulator(config: EnvConfig | None, changes: EnvOptions, **parts: Any) -> Simulator:
    """Build a Simulator from `config` (or the defaults) with `changes` put in (see `build`)."""
    return build(Simulator, config, changes, **parts)


def build(
    kind: Callable[..., Made],
    config: EnvConfig | None,
    changes: EnvOptions,
    *,
    num_worlds: int = 1,
    planner: Planner | str | None = None,
    **parts: Any,
) -> Made:
    """Build a Simulator, or what takes the same arguments, from `config` (or the defaults) with `changes` put in.

    `planner` is an object, or a name of PLANNERS that goes into the config; `parts` go to the Simulator as they
    are. ConfigError names an unknown parameter, with near matches; MapError says what is wrong with a map.
    """
    if config is not None and not isinstance(config, EnvConfig):
        raise ConfigError(f"config={shown(config)} must be of type EnvConfig")
    chosen: dict[str, Any] = {**changes}
    if isinstance(planner, str):
        chosen["planner"], planner = planner, None
    return kind((config or EnvConfig()).replace(**chosen), num_worlds, planner=planner, **parts)


def share_routes(simulators: Sequence[Simulator]) -> None:
    """Let the last simulator use an earlier one's routes if map, planner and lanes are the same."""
    last = simulators[-1]
    for other in simulators[:-1]:
        if _route_key(other) == _route_key(last):
            last.route_book = other.route_book
            return


def _route_key(simulator: Simulator) -> tuple[object, ...]:
    """Return what a route depends on besides its ends."""
    return simulator.grid.key, simulator.route_book.planner.key, simulator.config.keep_right
