"""Every default of the simulated warehouse, once, with its unit. All dataclasses are frozen and JSON-able."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypedDict, Unpack

from warehouse_env.checked import Checked, CheckedPart, check_names, from_plain
from warehouse_env.old_names import by_todays_names
from warehouse_env.traffic_spec import TRAFFIC, TrafficSpec, UncertaintySpec, preset_or_spec
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

ActionType = Literal["discrete", "continuous", "raw"]
ArrivalMode = Literal["pass", "stop", "pose"]
TrafficMode = Literal["none", "routes", "shield", "rules", "assist"]

# limits of single precision and of patience; a warehouse needs a thousandth
_LEAST, _MOST = 1e-3, 1e4  # [m], [s], [m/s] ...
_COMMANDS = 4096  # of discrete actions: speed levels x lateral offsets


@dataclass(frozen=True)
class RobotSpec(Checked):
    """Four wheels, rear steer, rear drive; the pose is the centre of the fixed front axle (paper 000, eq. 2).

    A front-steered vehicle is the same about its fixed rear axle, where eq. (2) holds as well. Most of its body lies
    ahead of that axle, and its steering angle has the opposite sign (wheels turned right turn it right).
    """

    length: float = 0.9  # [m]
    width: float = 0.6  # [m]
    height: float = 0.4  # [m], for pictures only
    wheelbase: float = 0.6  # [m], from the fixed axle (the front one) to the steered one
    front_overhang: float = 0.15  # [m], body ahead of the fixed axle; more than half: front-steered
    min_speed: float = -0.5  # [m/s]
    max_speed: float = 1.5  # [m/s]
    max_acceleration: float = 1.0  # [m/s^2], braking as well
    max_steering: float = math.radians(60.0)  # [rad], of the rear wheels, either side
    max_steering_rate: float = 1.5  # [rad/s]
    mass: float = 500.0  # [kg] without load
    payload: float = 500.0  # [kg] largest load, paper 000

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(_LEAST, _MOST, "length", "width", "height", "wheelbase")
        self._between(_LEAST, _MOST, "max_speed", "max_acceleration", "max_steering_rate")
        self._between(_LEAST, 1e9, "mass")
        self._between(0.0, 1e9, "payload")
        self._between(-_MOST, 0.0, "min_speed")
        self._between(_LEAST, 1.57, "max_steering")
        self._require(0 <= self.front_overhang < self.length, "front_overhang", "at least 0 and less than the length")

    @property
    def rear_reach(self) -> float:
        """Body behind the fixed axle [m]."""
        return self.length - self.front_overhang

    @property
    def farthest(self) -> float:
        """Distance of the body's farthest point from the fixed axle's centre [m]."""
        return math.hypot(max(self.rear_reach, self.front_overhang), self.width / 2)

    @property
    def least_radius(self) -> float:
        """Radius [m] of the sharpest turn of the fixed axle's centre."""
        return self.wheelbase / math.tan(self.max_steering)

    @property
    def longer(self) -> float:
        """Scale of lengths along a route: body length or least turning radius over the default, the larger."""
        usual = RobotSpec.wheelbase / math.tan(RobotSpec.max_steering)
        return max(self.length / RobotSpec.length, self.least_radius / usual)

    @property
    def wider(self) -> float:
        """Scale of lengths across a route: body width over the default."""
        return self.width / RobotSpec.width

    @property
    def front_steered(self) -> bool:
        """Whether the front wheels steer; the fixed axle is then under the rear half of the body."""
        return self.front_overhang > self.rear_reach


@dataclass(frozen=True)
class FleetPart(CheckedPart):
    """Robots of one kind in a fleet of several kinds."""

    count: int  # robots of this kind
    robot: RobotSpec  # their bodies and limits
    ranges: ClassVar = {"count": (1, 100_000)}


@dataclass(frozen=True)
class SensorSpec(Checked):
    """A robot's perception: lidar, its nearest robots, the route ahead, and an extra sensor."""

    retired: ClassVar[dict[str, Any]] = {"caution": 1.0}

    rays: int = 32  # of the lidar, evenly all round; or 0
    lidar_range: float = 6.0  # [m], from the body's centre
    neighbours: int = 6  # nearest robots within lidar_range; or 0
    route_points: int = 5  # of the route ahead; or 0
    route_spacing: float = 1.0  # [m] between route points ahead
    predictions: bool = False  # also the time to a predicted conflict of every (speed level, lateral offset)
    extra: str | None = None  # also an extra sensor's numbers: a name of SENSORS, or your own, FILE.py:CLASS

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(0, 4096, "rays", "neighbours", "route_points")
        self._between(_LEAST, _MOST, "lidar_range", "route_spacing")
        self._require(self.neighbours > 0 or not self.predictions, "predictions", "False without neighbours")


@dataclass(frozen=True)
class RewardWeights(CheckedPart):
    """Weights of the named reward terms (see simulation/senses/rewards.py); a term is per robot and step."""

    progress: float = 1.0  # per metre along the route
    arrival: float = 1.0  # per goal reached
    collision: float = -5.0  # per contact episode with a robot or a shelf
    contact: float = -0.5  # per step in contact
    proximity: float = -0.3  # per step at gap 0, fading out at three near_miss_gaps
    time: float = -0.01  # per step
    smoothness: float = -0.01  # per step, times the relative change of command
    # per metre driven in any direction. `progress` and `time` price detours already, and the shipped policies were
    # trained and measured with 0; below 0 makes way-giving dearer, too
    path_length: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(-1e12, 1e12, *(f.name for f in dataclasses.fields(self)))


@dataclass(frozen=True)
class EnvConfig(Checked):
    """One warehouse with its robots: all that defines an episode, except the seed."""

    retired: ClassVar[dict[str, Any]] = {"smooth_routes": False, "search_nodes": 6000, "search_period": 1}
    layout: str = "paper46"  # a name of LAYOUTS, as "aisles:seed=7", or a file, as "hall.map" or "hall.yaml:cell=0.75"
    num_agents: int = 8  # robots
    planner: str = "pf_aco"  # a name of PLANNERS
    # lifelong: a new goal after every arrival; one_shot: one goal each, then parked; or starts and goals by your own
    # sampler, FILE.py:CLASS
    tasks: str = "lifelong"
    action_type: ActionType = "discrete"  # what an action means (simulation/actions.py)
    max_steps: int = 1000  # env steps until truncation
    time_step: float = 0.1  # [s] of physics
    substeps: int = 2  # contact checks per physics step
    action_repeat: int = 1  # physics steps per env step; trainings set 2, and see twice the time
    # when a goal is reached. pass: near it at any speed; stop: standing near it; pose: standing at its pose
    arrival: ArrivalMode = "pass"
    arrival_radius: float = 0.5  # [m], front axle to the goal's point, of "pass" and "stop"
    pose_radius: float = 0.05  # [m], front axle to the goal's point, of "pose" and waiting places
    pose_angle: float = math.radians(5.0)  # [rad], heading to the goal's, likewise
    near_miss_gap: float = 0.1  # [m]
    quick_searches: bool = False  # short searches of manoeuvres in every tenth step, for many worlds on a GPU
    stuck_after: float = 60.0  # [s] without a metre of progress on the route
    terminate_on_collision: bool = False  # end a robot's episode at its first contact
    speed_levels: tuple[float, ...] = (-0.4, 0.0, 0.5, 1.5)  # [m/s], of discrete actions
    lateral_offsets: tuple[float, ...] = (0.0, 0.6, -0.6, 1.2, -1.2)  # [m], left of the route is positive
    # [m] that routes keep to the right of the planned path if there is room; scaled by the body's width
    keep_right: float = 0.5
    people: int = 0  # on foot, among the robots (simulation/physics/people.py)
    # how robots meet. none: they ignore each other; routes: they replan around others; shield: also brake before a
    # possible contact; rules: also have right of way; assist: rules only near robots that have stood for 30 s
    traffic: TrafficMode | TrafficSpec = "none"
    uncertainty: UncertaintySpec | None = None  # lost and late messages, and errors; None: none
    service: ServiceSpec | None = None  # robots stand to be loaded and unloaded; None: an arrival takes no time
    orders: OrderSpec | None = None  # goals come from orders; None: random goals without end
    battery: BatterySpec | None = None  # robots use energy and charge; None: they need none
    robot: RobotSpec = field(default_factory=RobotSpec)  # its body and limits
    fleet: tuple[FleetPart, ...] = ()  # robots of other kinds than `robot`: the last ones, part by part
    sensor: SensorSpec = field(default_factory=SensorSpec)  # its perception
    reward: RewardWeights = field(default_factory=RewardWeights)  # weights of its terms
    ranges: ClassVar = {
        "num_agents": (1, 100_000), "max_steps": (1, 2**63 - 1), "substeps": (1, 1000), "action_repeat": (1, 1000),
        "time_step": (_LEAST, 10.0), "arrival_radius": (_LEAST, _MOST), "pose_radius": (_LEAST, _MOST),
        "near_miss_gap": (_LEAST, _MOST), "pose_angle": (_LEAST, math.pi), "stuck_after": (_LEAST, 1e12),
        "keep_right": (0.0, 100.0), "people": (0, 1000), "speed_levels": (-_MOST, _MOST),
        "lateral_offsets": (-_MOST, _MOST),
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("speed_levels", "lateral_offsets"):
            self._require(1 <= len(getattr(self, name)) <= _COMMANDS, name, f"1 to {_COMMANDS} numbers")
        levels = len(self.speed_levels)
        rule = f"at most {_COMMANDS // levels} numbers beside {levels} speed_levels"
        self._require(levels * len(self.lateral_offsets) <= _COMMANDS, "lateral_offsets", rule)
        self._check_fleet()
        self._check_traffic()
        self._check_work()

    def _check_fleet(self) -> None:
        """Refuse parts with more robots than the fleet has."""
        least = sum(part.count for part in self.fleet)
        rule = f"of at most {self.num_agents} robots in all, the num_agents, and not of {least}"
        self._require(least <= self.num_agents, "fleet", rule)

    def _check_traffic(self) -> None:
        """Keep a preset by its name, and refuse traffic that other options rule out (docs/traffic.md)."""
        object.__setattr__(self, "traffic", preset_or_spec(self.traffic_spec))
        object.__setattr__(self, "uncertainty", None if self.uncertainty == UncertaintySpec() else self.uncertainty)
        spec = self.traffic_spec
        rule = "without right of way for raw actions, which follow no route"
        self._require(self.action_type != "raw" or not spec.right_of_way, "traffic", rule)

    def _check_work(self) -> None:
        """Refuse work unless robots continue after an arrival, and stand there to be served."""
        for name in ("service", "orders", "battery"):
            on = getattr(self, name) is not None
            goes_on = self.tasks == "lifelong" and not self.terminate_on_collision
            self._require(goes_on or not on, name, "None unless tasks are lifelong and no collision ends an episode")
            stands = self.arrival != "pass"
            self._require(stands or not on, name, 'None unless robots stand where they arrive; set arrival="stop"')
        if self.service is not None:
            fits = self.service.load <= self.payload
            self._require(fits, "service", f"of a load up to the robot's payload of {self.payload:g} kg")

    @property
    def traffic_spec(self) -> TrafficSpec:
        """The single switches of `traffic`."""
        return TRAFFIC[self.traffic] if isinstance(self.traffic, str) else self.traffic

    @property
    def uncertainty_spec(self) -> UncertaintySpec:
        """`uncertainty`, or zeros."""
        return self.uncertainty or UncertaintySpec()

    @property
    def kinds(self) -> tuple[RobotSpec, ...]:
        """The kinds of robots: `robot`, then those of the parts of the fleet."""
        return self.robot, *(part.robot for part in self.fleet)

    @property
    def kind_of(self) -> tuple[int, ...]:
        """Each robot's index into `kinds`."""
        counts = [part.count for part in self.fleet]
        counts = [self.num_agents - sum(counts), *counts]
        return tuple(kind for kind, count in enumerate(counts) for _ in range(count))

    @property
    def robots(self) -> tuple[RobotSpec, ...]:
        """Each robot's kind."""
        kinds = self.kinds
        return tuple(kinds[kind] for kind in self.kind_of)

    @property
    def bodies(self) -> tuple[RobotSpec, ...]:
        """The different kinds among the robots, each once."""
        return tuple(dict.fromkeys(self.robots)) if self.fleet else (self.robot,)

    @property
    def widest_body(self) -> RobotSpec:
        """The body that floors, lanes and places are made for: it covers all bodies, and turns no sharper than any."""
        bodies = self.bodies
        if len(bodies) == 1:
            return bodies[0]
        ahead, behind = max(body.front_overhang for body in bodies), max(body.rear_reach for body in bodies)
        turns = max(bodies, key=lambda body: body.least_radius)
        return dataclasses.replace(
            turns, length=ahead + behind, front_overhang=ahead, width=max(body.width for body in bodies)
        )

    @property
    def payload(self) -> float:
        """Load that every robot can carry [kg]."""
        return min(body.payload for body in self.bodies)

    @property
    def works(self) -> bool:
        """Whether robots do more than drive from goal to goal: service, orders or charging."""
        return any(part is not None for part in (self.service, self.orders, self.battery))

    @property
    def loads(self) -> bool:
        """Whether robots carry loads, which make them slower."""
        return self.orders is not None or (self.service is not None and self.service.load > 0)

    def replace(self, **changes: Unpack[ConfigChanges]) -> EnvConfig:
        """Return a copy with some fields changed; unknown names raise ConfigError."""
        check_names("EnvConfig parameter", changes, self)
        return dataclasses.replace(self, **changes)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON types."""
        return dataclasses.asdict(self)

    @classmethod
    def upgraded(cls, data: dict[str, Any]) -> dict[str, Any]:
        """Return stored fields under today's names."""
        return by_todays_names(data)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> EnvConfig:
        """Build from a `to_dict` of this or an older version; ConfigError for unknown names and wrong values."""
        return from_plain(cls, data)


# What to start learning in: live routes, so that jams are not the policy's fault; for every action the time to a
# predicted conflict; a decision every 0.2 s, and episodes of 120 s.
LEARNING = EnvConfig(traffic="routes", sensor=SensorSpec(predictions=True), action_repeat=2, max_steps=600)


# For type checkers and editors, which cannot read keyword arguments off a dataclass: `python -m tests.test_config`
# writes the fields of EnvOptions from EnvConfig's.


class EnvOptions(TypedDict, total=False):
    """Fields of EnvConfig as the env functions take them by name; `planner` may be an object there."""

    layout: str
    num_agents: int
    tasks: str
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
    quick_searches: bool
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
