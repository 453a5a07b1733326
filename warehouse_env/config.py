"""Every default of the simulated warehouse, once, with its unit. All dataclasses are frozen and JSON-able."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from warehouse_env.errors import ConfigError

ActionType = Literal["discrete", "continuous", "raw"]
TaskMode = Literal["lifelong", "one_shot"]


def _require(condition: bool, parameter: str, value: object, rule: str) -> None:
    if not condition:
        raise ConfigError(f"{parameter}={value!r} must be {rule}")


def _positive(owner: object, *parameters: str) -> None:
    for parameter in parameters:
        value = getattr(owner, parameter)
        _require(math.isfinite(value) and value > 0, parameter, value, "a finite number above 0")


def _not_negative(owner: object, *parameters: str) -> None:
    for parameter in parameters:
        value = getattr(owner, parameter)
        _require(math.isfinite(value) and value >= 0, parameter, value, "a finite number of at least 0")


@dataclass(frozen=True)
class RobotSpec:
    """Four wheels, rear steer, rear drive; the pose is the centre of the fixed front axle (paper 000, eq. 2)."""

    length: float = 0.9  # [m]
    width: float = 0.6  # [m]
    height: float = 0.4  # [m], for pictures only
    wheelbase: float = 0.6  # [m], front axle to the steered rear axle
    front_overhang: float = 0.15  # [m], body ahead of the front axle
    min_speed: float = -0.5  # [m/s]
    max_speed: float = 1.5  # [m/s]
    max_acceleration: float = 1.0  # [m/s^2], braking as well
    max_steering: float = math.radians(60.0)  # [rad], of the rear wheels, either side
    max_steering_rate: float = 1.5  # [rad/s]
    payload: float = 500.0  # [kg], paper 000; for pictures and cards only

    def __post_init__(self) -> None:
        _positive(self, "length", "width", "height", "wheelbase", "max_speed", "max_acceleration", "max_steering_rate")
        _not_negative(self, "front_overhang", "payload")
        _require(self.front_overhang < self.length, "front_overhang", self.front_overhang, "less than the length")
        _require(self.min_speed <= 0 and math.isfinite(self.min_speed), "min_speed", self.min_speed, "0 or negative")
        _require(0 < self.max_steering < math.pi / 2, "max_steering", self.max_steering, "between 0 and pi/2 rad")

    @property
    def rear_reach(self) -> float:
        """Body behind the front axle [m]."""
        return self.length - self.front_overhang


@dataclass(frozen=True)
class SensorSpec:
    """What a robot perceives: lidar, its nearest robots, and the route ahead."""

    rays: int = 32
    lidar_range: float = 6.0  # [m], from the body's centre
    neighbours: int = 6  # nearest robots within lidar_range
    route_points: int = 5
    route_spacing: float = 1.0  # [m] between route points ahead
    predictions: bool = False  # also the time to a predicted conflict of every (speed level, lateral offset)

    def __post_init__(self) -> None:
        _positive(self, "lidar_range", "route_spacing")
        for name in ("rays", "neighbours", "route_points"):
            _require(getattr(self, name) >= 1, name, getattr(self, name), "at least 1")


@dataclass(frozen=True)
class RewardWeights:
    """Weights of the named reward terms (see simulation/rewards.py); a term is per robot and step."""

    progress: float = 1.0  # per metre along the route
    arrival: float = 1.0  # per goal reached
    collision: float = -5.0  # per contact episode with a robot or a shelf
    contact: float = -0.5  # per step in touch
    proximity: float = -0.3  # per step at gap 0, fading out at three near_miss_gaps
    time: float = -0.01  # per step
    smoothness: float = -0.01  # per step, times the relative change of command
    # per metre driven in any direction. 0: `progress` pays the way and `time` charges detours already, and the shipped
    # policies were trained, and their returns measured, without it; below 0 it makes way-giving dearer, too
    path_length: float = 0.0

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):
            value = getattr(self, f.name)
            _require(math.isfinite(value), f"RewardWeights.{f.name}", value, "a finite number")


@dataclass(frozen=True)
class EnvConfig:
    """One warehouse with its robots: all that defines an episode but the seed."""

    layout: str = "paper46"  # a name of LAYOUTS, unless map_file is given
    map_file: str | None = None  # a MovingAI .map
    num_agents: int = 8
    planner: str = "pf_aco"  # a name of PLANNERS
    tasks: TaskMode = "lifelong"
    action_type: ActionType = "discrete"
    max_steps: int = 1000  # env steps until truncation
    time_step: float = 0.1  # [s] of physics
    substeps: int = 2  # contact checks per physics step
    action_repeat: int = 1  # physics steps per env step; the shipped policies decide every 0.2 s, so they set 2
    arrival_radius: float = 0.5  # [m], front axle to the goal cell's centre
    near_miss_gap: float = 0.1  # [m]
    stuck_after: float = 60.0  # [s] without a metre of progress on the route
    terminate_on_collision: bool = False
    speed_levels: tuple[float, ...] = (-0.4, 0.0, 0.5, 1.3)  # [m/s], of discrete actions
    lateral_offsets: tuple[float, ...] = (0.0, 0.6, -0.6, 1.2, -1.2)  # [m], left of the route is positive
    keep_right: float = 0.5  # [m] that routes move to the right of the planned path where there is room
    smooth_routes: bool = False  # bound the routes' curvature by the steering limit (routes/steerable.py)
    robot: RobotSpec = field(default_factory=RobotSpec)
    sensor: SensorSpec = field(default_factory=SensorSpec)
    reward: RewardWeights = field(default_factory=RewardWeights)

    def __post_init__(self) -> None:
        for name in ("num_agents", "max_steps", "substeps", "action_repeat"):
            value = getattr(self, name)
            _require(isinstance(value, int) and value >= 1, name, value, "a whole number of at least 1")
        _positive(self, "time_step", "arrival_radius", "near_miss_gap", "stuck_after")
        _not_negative(self, "keep_right")
        _require(isinstance(self.smooth_routes, bool), "smooth_routes", self.smooth_routes, "True or False")
        for name, choices in (("tasks", get_args(TaskMode)), ("action_type", get_args(ActionType))):
            _require(getattr(self, name) in choices, name, getattr(self, name), f"one of {', '.join(choices)}")
        for name in ("speed_levels", "lateral_offsets"):
            values = getattr(self, name)
            _require(
                len(values) >= 1 and all(math.isfinite(v) for v in values), name, values, "finite numbers, one or more"
            )
            object.__setattr__(self, name, tuple(float(v) for v in values))

    def replace(self, **changes: Any) -> EnvConfig:
        """Return a copy with some fields changed; unknown names raise ConfigError."""
        check_names("EnvConfig parameter", changes, self)
        return dataclasses.replace(self, **changes)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON types."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> EnvConfig:
        """Build from `to_dict`'s result; raises ConfigError on unknown names."""
        check_names("EnvConfig parameter", data, cls)
        data = dict(data)
        for name, kind in (("robot", RobotSpec), ("sensor", SensorSpec), ("reward", RewardWeights)):
            if isinstance(data.get(name), dict):
                check_names(f"{kind.__name__} parameter", data[name], kind)
                data[name] = kind(**data[name])
        return cls(**data)


def check_names(kind: str, given: dict[str, Any], owner: Any) -> None:
    """Raise ConfigError, with near matches, for a key that is no field of the dataclass `owner`."""
    from warehouse_env.errors import unknown_name

    known = [f.name for f in dataclasses.fields(owner)]
    for name in given:
        if name not in known:
            raise unknown_name(kind, name, known)
