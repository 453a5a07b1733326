"""Option types for editors and mypy: `python -m tests.env_options` writes them from EnvConfig."""

from __future__ import annotations

from typing import TypedDict

from warehouse_env.config import (
    ActionType,
    ArrivalMode,
    FleetPart,
    RewardWeights,
    RobotSpec,
    SensorSpec,
    TaskMode,
    TrafficMode,
)
from warehouse_env.traffic_spec import TrafficSpec, UncertaintySpec
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec


class EnvOptions(TypedDict, total=False):
    """Fields of EnvConfig as the env functions take them by name; `planner` may be an object there."""

    layout: str
    num_agents: int
    tasks: TaskMode
    action_type: ActionType
    max_steps: int
    time_step: float
    substeps: int
    action_repeat: int
    arrival: ArrivalMode
    arrival_radius: float
    pose_radius: float
    pose_angle: float
    near_miss_gap: float
    stuck_after: float
    terminate_on_collision: bool
    speed_levels: tuple[float, ...]
    lateral_offsets: tuple[float, ...]
    keep_right: float
    people: int
    traffic: TrafficMode | TrafficSpec
    uncertainty: UncertaintySpec | None
    service: ServiceSpec | None
    orders: OrderSpec | None
    battery: BatterySpec | None
    robot: RobotSpec
    fleet: tuple[FleetPart, ...]
    sensor: SensorSpec
    reward: RewardWeights


class ConfigChanges(EnvOptions, total=False):
    """Every field of EnvConfig."""

    planner: str
