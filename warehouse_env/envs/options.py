"""How every adapter reads its keyword arguments."""

from __future__ import annotations

from typing import Any

from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, shown
from warehouse_env.planning.plan import Planner
from warehouse_env.simulation.simulator import Simulator


def build_simulator(
    config: EnvConfig | None,
    changes: dict[str, Any],
    *,
    num_worlds: int = 1,
    planner: Planner | str | None = None,
    **parts: Any,
) -> Simulator:
    """Build a Simulator from `config` (or the defaults) with `changes` put in.

    `planner` is an object, or a name of PLANNERS that goes into the config; `parts` go to the Simulator as they
    are. ConfigError names an unknown parameter, with near matches; MapError says what is wrong with a map.
    """
    if config is not None and not isinstance(config, EnvConfig):
        raise ConfigError(f"config={shown(config)} must be of type EnvConfig")
    if isinstance(planner, str):
        changes, planner = {**changes, "planner": planner}, None
    return Simulator((config or EnvConfig()).replace(**changes), num_worlds, planner=planner, **parts)
