"""The observation's named slices: what every policy reads, and the simulator writes."""

from collections.abc import Callable
from typing import Any, NamedTuple

from warehouse_env import plugins
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, shown

EGO = 8  # speed, steering, follower's steering, bearing, lateral, remaining, contact time, waiting time
FIELD = 2  # held, time held
GOAL = 5  # x, y, cos, sin, to be braked for
NEEDS = 3  # load, being served, seconds of it left; with a battery its charge
NEIGHBOUR = 7  # x, y, cos, sin, vx, vy, present

SENSORS: dict[str, Callable[..., Any]] = {}
"""Extra sensors, which SensorSpec.extra names: classes that are made from an EnvConfig."""


def add_sensor(text: str) -> None:
    """Load a user's sensor, "my_sensor.py:Mine" or "module:Mine", into SENSORS; ConfigError if it is none."""
    plugins.add(text, "sensor", SENSORS, ("observe(view)",))


def make_sensor(config: EnvConfig) -> Any:
    """Make the extra sensor that a config names; ConfigError for an unknown name and for what is no sensor."""
    name = config.sensor.extra
    sensor = plugins.make(name, "sensor", SENSORS, {}, config)
    plugins.check_has(str(name), "sensor", sensor, ("size", "observe(view)"))
    if not (isinstance(sensor.size, int) and 1 <= sensor.size <= 4096):
        raise ConfigError(f"{name} has the size {shown(sensor.size)}, which must be a whole number from 1 to 4,096")
    return sensor


class Starts(NamedTuple):
    """Where in the flat vector the slices start that kernels write behind the lidar; None: there is no such slice."""

    ego: int
    route: int
    neighbours: int
    predictions: int | None
    field: int | None
    goal: int | None


class Slices(dict[str, slice]):
    """Names -> slices of the flat vector; ConfigError for one that the config leaves out."""

    def __missing__(self, name: str) -> slice:
        raise ConfigError(f"the observation has only {', '.join(self)}: give it the slice {name!r} by SensorSpec")


class ObservationLayout(NamedTuple):
    """The slices of the flat vector by name; `size` is its length."""

    slices: Slices
    size: int

    @property
    def starts(self) -> Starts:
        """Starts of the slices that kernels write; 0 for route and neighbours if there are none."""
        found = {"route": 0, "neighbours": 0} | {name: part.start for name, part in self.slices.items()}
        return Starts._make(found.get(name) for name in Starts._fields)


def observation_layout(config: EnvConfig) -> ObservationLayout:
    """Return the layout of one robot's observation, all in its own frame and scaled to about 1, without empty slices.

    lidar[rays]: 1 / (1 + d), d [m] from the body's centre to a shelf or robot; ray k at 2 pi k / rays from the nose,
        counter-clockwise.
    ego[8]: speed / max_speed, steering / max_steering, the path follower's steering / max_steering,
        route direction minus heading / pi, metres left of the route, min(metres to go, 20) / 20,
        min(seconds in touch, 5) / 5, min(seconds standing, 20) / 20.
    route[2 x route_points]: (x, y) / 5 m of the route at route_spacing, 2 route_spacing, ... ahead.
    neighbours[7 x neighbours], nearest first: (x, y) / lidar_range of the other body's centre from the own,
        cos and sin of the relative heading, relative velocity (x, y) / max_speed, 1; all 0 where nobody is, or is heard
        of (UncertaintySpec.loss).
    predictions[speed_levels x lateral_offsets], if the sensor has them: share of the next seconds until the command
        would lead to a conflict, 1 where it would not (simulation/senses/prediction.py).
    extra[K], if the sensor names one: what it observes (senses/extra.py).
    field[2], if there is a protective field: share of the last env step in which it held the robot back,
        min(seconds for which it has done so without a break, 5) / 5.
    goal[5], if robots stop at goals (EnvConfig.arrival): (x, y) / 5 m of the goal's point, each within +-4; cos and sin
        of the goal's heading minus the own, both 0 where any will do; 1 where it must brake to stop there, else 0.
    needs[3 or 4], if robots are served, carry out orders or charge: load / payload, 1 while it is served,
        min(seconds of that left, 60) / 60, and with a battery the share of its capacity that is left.
    """
    slices, start = Slices(), 0
    for name, size in _sizes(config).items():
        if size:
            slices[name] = slice(start, start + size)
        start += size
    return ObservationLayout(slices, start)


def _sizes(config: EnvConfig) -> dict[str, int]:
    """Return the numbers of each slice, in their order; 0 for an empty one."""
    sensor = config.sensor
    sizes = {
        "lidar": sensor.rays, "ego": EGO, "route": 2 * sensor.route_points, "neighbours": NEIGHBOUR * sensor.neighbours,
    }  # fmt: skip
    if sensor.predictions:
        sizes["predictions"] = len(config.speed_levels) * len(config.lateral_offsets)
    if sensor.extra is not None:
        sizes["extra"] = make_sensor(config).size
    if config.traffic_spec.shield:
        sizes["field"] = FIELD
    if config.arrival != "pass":  # last, so that policies without it read the slices before
        sizes["goal"] = GOAL
    if config.works:
        sizes["needs"] = NEEDS + (config.battery is not None)
    return sizes
