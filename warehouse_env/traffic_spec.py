"""How robots meet, as a part of EnvConfig: named presets, the single switches behind them, and what is uncertain."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from warehouse_env.checked import CheckedPart, from_plain, parse_named
from warehouse_env.errors import check_known

OWN = "own"  # in a text: the traffic that a policy needs


@dataclass(frozen=True)
class TrafficSpec(CheckedPart):
    """The single switches behind `EnvConfig.traffic` (docs/traffic.md)."""

    # Names that stored configurations may still hold, with the only values that they may have (checked.from_plain).
    retired: ClassVar[dict[str, Any]] = {
        "planner": None, "every": 4.0, "look_ahead": 10.0, "stood_for": 6.0, "saving": 0.5, "scanner_rays": 360,
        "unseen_speed": 0.0, "standing": 10.0, "beside": 3.0, "against": 1.0, "boxed_against": 8.0, "crowd": 0.6,
        "crowd_within": 10.0, "turn": 1.0, "boxed_turn": 30.0,
    }  # fmt: skip

    shield: bool = False  # robots brake before a possible contact with others, known by messages
    margin: float = 0.02  # [m] that the shield keeps between robots
    right_of_way: bool = False  # rules give right of way early, and move robots aside; needs the shield
    right_of_way_after: float = 0.0  # [s] of standing in a wait cycle after which the rules act near it; 0: always
    # replan while driving, around standing robots and oncoming routes; "barred": only robots whose route is
    # blocked, in half the time (trainings)
    routes: bool | Literal["barred"] = False
    ranges: ClassVar = {"margin": (0.0, 10.0), "right_of_way_after": (0.0, 1e4)}

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(bool(self.shield) or not self.right_of_way, "right_of_way", "False without a shield")


TRAFFIC: dict[str, TrafficSpec] = {
    "none": TrafficSpec(),
    "routes": TrafficSpec(routes=True),
    "shield": TrafficSpec(shield=True, routes=True),
    "rules": TrafficSpec(shield=True, routes=True, right_of_way=True),
    "assist": TrafficSpec(shield=True, routes=True, right_of_way=True, right_of_way_after=30.0),
}


def preset_or_spec(spec: TrafficSpec) -> Any:
    """Return the name of the preset that a spec equals, or the spec."""
    return next((name for name, preset in TRAFFIC.items() if preset == spec), spec)


def read_traffic(text: str, own: TrafficSpec | None = None) -> TrafficSpec:
    """Return the traffic of a text: a preset, with switches of TrafficSpec behind it, as in "rules:routes=false".

    own: what "own" stands for, the traffic that a policy needs; None: no preset. Raises ConfigError.
    """
    name, switches = parse_named(text, "traffic", "rules:routes=false")
    known = TRAFFIC if own is None else {OWN: own, **TRAFFIC}
    check_known("traffic", [name], known)
    return from_plain(TrafficSpec, {**vars(known[name]), **switches})


def written_traffic(spec: TrafficSpec) -> str:
    """Return the text from which `read_traffic` makes a spec."""
    named = preset_or_spec(spec)
    if isinstance(named, str):
        return named
    switches = (f"{name}={value}" for name, value in vars(spec).items() if value != getattr(TRAFFIC["none"], name))
    return f"none:{','.join(switches)}".replace("=True", "=true").replace("=False", "=false")


def driven_with(base: TrafficSpec, needed: TrafficSpec) -> TrafficSpec:
    """Return a base's traffic with the switches that a policy needs turned on; "barred" stays as it is."""
    return replace(
        base, shield=base.shield or needed.shield, right_of_way=needed.right_of_way or base.right_of_way,
        right_of_way_after=needed.right_of_way_after or base.right_of_way_after,
        routes=base.routes or bool(needed.routes),
    )  # fmt: skip


@dataclass(frozen=True)
class ErrorBounds(CheckedPart):
    """Bounds of message latency, and of errors in poses and actuation."""

    latency: float = 0.0  # [s] longest delay of a message, uniform from 0
    pose_error: float = 0.0  # [m] largest error of a robot's own position
    heading_error: float = 0.0  # [rad] largest error of its own heading
    actuation_error: float = 0.0  # largest relative error of acceleration and steering
    ranges: ClassVar = {
        "latency": (0.0, 60.0), "pose_error": (0.0, 1.0), "heading_error": (0.0, 0.5), "actuation_error": (0.0, 0.5),
    }  # fmt: skip

    @property
    def errs(self) -> bool:
        """Whether poses, headings or actuators may be off."""
        return any((self.pose_error, self.heading_error, self.actuation_error))


@dataclass(frozen=True)
class UncertaintySpec(ErrorBounds):
    """Lost and late messages, and errors; the shield holds within the declared bounds (docs/traffic.md)."""

    loss: float = 0.0  # share of env steps in which a robot's messages are lost (simulation/senses/messages.py)
    burst: float = 0.0  # [s] length of each loss; at least one env step
    declared: ErrorBounds | None = None  # bounds that the shield assumes; None: the real ones
    ranges: ClassVar = {"loss": (0.0, 1.0), "burst": (0.0, 3600.0)}

    @property
    def bounds(self) -> ErrorBounds:
        """The bounds that the shield assumes."""
        return self if self.declared is None else self.declared
