"""A warehouse of rear-steering robots: PettingZoo, Gymnasium and SB3 environments over one fast simulator.

Importing this package registers "Warehouse-v0" with Gymnasium and loads nothing heavy: every public name below is
imported when it is first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from warehouse_env.config import LEARNING, EnvConfig, FleetPart, RewardWeights, RobotSpec, SensorSpec
    from warehouse_env.envs.callback import MetricsCallback
    from warehouse_env.envs.parallel import WarehouseParallelEnv, WarehouseSingleEnv, aec_env, parallel_env, single_env
    from warehouse_env.envs.tensors import WarehouseTensorEnv, tensor_env
    from warehouse_env.envs.vector import WarehouseVecEnv, vec_env
    from warehouse_env.errors import ActionError, ConfigError, MapError, PlanError, WarehouseError, WeightsError
    from warehouse_env.maps.grid_map import GridMap
    from warehouse_env.maps.layouts import LAYOUTS, make_layout
    from warehouse_env.maps.movingai import read_map, read_scen, write_map
    from warehouse_env.observation import SENSORS, observation_layout
    from warehouse_env.planning import PLANNERS, BasePlanner, make_planner
    from warehouse_env.planning.plan import Plan, Planner
    from warehouse_env.render.frame import Scene, draw, scene_of
    from warehouse_env.render.video import VideoWriter
    from warehouse_env.simulation.simulator import Simulator
    from warehouse_env.threads import set_num_threads
    from warehouse_env.traffic_spec import ErrorBounds, TrafficSpec, UncertaintySpec
    from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

__version__ = "0.1.0"

_HOME = {  # public name -> the module that holds it
    name: module
    for module, names in {
        "config": "LEARNING EnvConfig FleetPart RewardWeights RobotSpec SensorSpec",
        "envs.callback": "MetricsCallback",
        "envs.parallel": "WarehouseParallelEnv WarehouseSingleEnv aec_env parallel_env single_env",
        "envs.tensors": "WarehouseTensorEnv tensor_env",
        "envs.vector": "WarehouseVecEnv vec_env",
        "errors": "ActionError ConfigError MapError PlanError WarehouseError WeightsError",
        "maps.grid_map": "GridMap",
        "maps.layouts": "LAYOUTS make_layout",
        "maps.movingai": "read_map read_scen write_map",
        "observation": "SENSORS observation_layout",
        "planning": "PLANNERS BasePlanner make_planner",
        "planning.plan": "Plan Planner",
        "render.frame": "Scene draw scene_of",
        "render.video": "VideoWriter",
        "simulation.simulator": "Simulator",
        "threads": "set_num_threads",
        "traffic_spec": "ErrorBounds TrafficSpec UncertaintySpec",
        "work": "BatterySpec OrderSpec ServiceSpec",
    }.items()
    for name in names.split()
}

__all__ = [
    "LAYOUTS", "LEARNING", "PLANNERS", "SENSORS", "ActionError", "BasePlanner", "BatterySpec", "ConfigError",
    "EnvConfig", "ErrorBounds", "FleetPart", "GridMap", "MapError", "MetricsCallback", "OrderSpec", "Plan", "PlanError",
    "Planner", "RewardWeights", "RobotSpec", "Scene", "SensorSpec", "ServiceSpec", "Simulator", "TrafficSpec",
    "UncertaintySpec", "VideoWriter", "WarehouseError", "WarehouseParallelEnv", "WarehouseSingleEnv",
    "WarehouseTensorEnv", "WarehouseVecEnv", "WeightsError", "__version__", "aec_env", "draw", "make_layout",
    "make_planner", "observation_layout", "parallel_env", "read_map", "read_scen", "scene_of", "set_num_threads",
    "single_env", "tensor_env", "vec_env", "write_map",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use and keep it."""
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))


if "Warehouse-v0" not in gymnasium.registry:  # importlib.reload must not warn
    gymnasium.register("Warehouse-v0", entry_point="warehouse_env.envs.parallel:WarehouseSingleEnv")
