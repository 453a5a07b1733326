"""The state of all robots and people: one structured array each, and its named views.

ROBOT nests one record for each part of the simulation that writes it. Ten arrays instead of one would cost a step of
one robot 2% for unpacking and gain nothing.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig, RobotSpec

F, I, B = np.float32, np.int32, np.int8  # noqa: E741

NOBODY = -1  # no robot, in vetoed_by and yields_to
ALONE, AROUND_OTHERS = 1, 2  # manoeuvre that a robot seeks: to its route, or also around other bodies


def _record(*fields: tuple[str, Any]) -> np.dtype[Any]:
    return np.dtype(list(fields), align=True)


MOTION = _record(
    ("x", F), ("y", F), ("heading", F),  # front axle [m], [m], [rad]
    ("speed", F), ("steer", F),  # [m/s], [rad]
    ("cos", F), ("sin", F),  # of the heading
)  # fmt: skip

# A robot, by the part of the simulation that owns the fields.
ROBOT = _record(
    ("motion", MOTION),
    ("commanded", _record(
        ("wanted_speed", F), ("wanted_offset", F),  # [m/s] and [m] of the action
        ("target_speed", F), ("target_steer", F),  # [m/s], [rad], by the path follower
        ("previous_speed", F), ("previous_steer", F),  # of the previous env step, for smoothness
        ("follow_steer", F),  # [rad], by the path follower without a lateral offset
    )),
    ("on_route", _record(
        ("points", I), ("spacing", F), ("position", F),  # way-points, [m] between them, [m] of arc length reached
        ("lateral", F), ("bearing", F),  # [m] left of the route; route direction minus heading [rad]
    )),
    ("task", _record(
        ("goal_x", F), ("goal_y", F), ("goal_row", I), ("goal_col", I),
        ("goal_heading", F), ("either", B),  # [rad], nan: any; also the other way round (driver/arrival.py)
        ("alive", B), ("acting", B),  # acting: was alive when the env step began
        ("age", I),  # physics steps on the way to the goal
    )),
    ("events", _record(  # of the last env step
        ("progress", F), ("driven", F), ("gap", F), ("arrived", B), ("touching", B),
        ("hit_robot", I), ("hit_shelf", I), ("near_miss", I), ("hit_person", I),
        ("shelf_contact", B), ("person_contact", B),  # in an episode of contact
    )),
    ("totals", _record(  # of the episode
        ("distance", np.float64), ("planned", np.float64), ("driven_to_goals", np.float64),
        ("distance_at_goal", np.float64), ("task_length", np.float64),  # task_length: [m] of the task's first route
        ("min_gap", F), ("hits_robot", I), ("hits_shelf", I), ("hits_person", I), ("near_misses", I),
        ("goals", I), ("late_goals", I), ("finish_time", F),  # late: reached after max_steps / 2
        ("lived", I), ("waited", I), ("longest_age", I),  # physics steps alive, standing, to any goal reached
        ("longest_standing", F), ("reroutes", I),  # [s]; routes replanned on the way
    )),
    ("shield", _record(
        ("vetoed", I), ("vetoed_by", I), ("vetoed_time", F),  # in the last env step; by whom; [s] without a break
        ("silent", B),  # its messages of this env step are lost (senses/messages.py)
        ("off_plan", B),  # it is not where it has planned to be (physics/deviation.py)
    )),
    ("manoeuvre", _record(  # driver/driving.py
        ("arcs", B), ("arc", B), ("arc_x", F), ("arc_y", F), ("arc_heading", F),  # arcs, 0: none; the current one and
        ("arc_left", F),  # the reference pose on it; [m] of it to go, negative backwards
        ("arc_margin", F), ("arc_planned", F),  # [m] kept from shelves; where there is room for it
        ("search_wait", F), ("seeks", B),  # [s] until the next search; it waits for one (ALONE, AROUND_OTHERS), or 0
        ("join", F), ("docks", B),  # [m] before the route's end from which to dock; docking, or at the end of it
    )),
    ("traffic", _record(  # traffic/right_of_way.py
        ("claim", np.float64), ("authority", F), ("side", F), ("at_end", B),  # granted up to this odometer [m], how
        # far that is [m], with which lateral offset [m]; the goal is granted, too
        ("path_from", np.float64), ("path_at", np.float64), ("poses", I),  # odometer [m] when the path was made, kept
        ("yields_to", I), ("right", I), ("retreating", B), ("pause", F),  # waits for whom; steps; [s] without a search
        ("rules_active", F),  # [s] left for which it keeps to its grants
    )),
    ("clocks", _record(
        ("contact_time", F), ("waiting_time", F), ("standing_time", F),  # [s] in touch; standing; within 1 m of
        ("anchor_x", F), ("anchor_y", F),  # [m]
        ("stalled_time", F), ("milestone", F),  # [s] since the robot came so far [m] along its route
    )),
)  # fmt: skip
OWNER = {name: owner for owner, (record, *_) in ROBOT.fields.items() for name in record.names}  # type: ignore


def fresh_robot() -> NDArray[np.void]:
    """Return ROBOT[1], a robot at the beginning of an episode that stands nowhere yet."""
    robot = np.zeros(1, dtype=ROBOT)
    robot["task"]["alive"] = 1
    robot["events"]["gap"] = robot["totals"]["min_gap"] = GAP_HORIZON
    robot["shield"]["vetoed_by"] = robot["traffic"]["yields_to"] = NOBODY
    return robot


PERSON = np.dtype(
    [
        ("x", F), ("y", F), ("cos", F), ("sin", F),  # [m], and which way it walks
        ("goal_x", F), ("goal_y", F),  # [m]
        ("rest", F), ("blocked", F),  # [s] to stand at its goal; [s] that it has not come on
        ("left", F),  # [cells] to its goal, at the least
        ("wants", B),  # another goal (simulation/physics/people.py)
        ("anchor_x", F), ("anchor_y", F), ("kept", F), ("longest_kept", F),  # [m]; [s] kept by robots within 1 m of it
    ],
    align=True,
)  # fmt: skip
PERSON_RADIUS = 0.25  # [m]

PARAMETERS = np.dtype(
    [
        ("dt", F), ("time_step", F), ("substeps", I), ("repeat", I), ("latency", I),  # latency: in physics steps
        ("half_length", F), ("half_width", F), ("offset", F), ("radius", F),  # [m]; offset: front axle to centre
        ("kind", I), ("widest", F), ("widest_length", F), ("widest_width", F),  # number of its kind; [m], see LARGEST
        ("wheelbase", F), ("min_speed", F), ("max_speed", F), ("max_acceleration", F),
        ("max_steer", F), ("max_steer_rate", F),
        ("length_scale", F), ("width_scale", F),  # beside RobotSpec()
        ("arrival_radius", F), ("pose_radius", F), ("arrival_angle", F),  # [m], [m], [rad]
        ("beyond", F),  # [m] aimed at beyond a route
        ("near_miss_gap", F), ("pair_range", F), ("stride", F), ("blur", F),
        ("cell", F), ("lidar_range", F), ("rays", I), ("neighbours", I), ("route_points", I), ("route_spacing", F),
        ("most_pairs", I), ("bucket", F), ("bucket_rows", I), ("bucket_columns", I),  # [m]; set by the Simulator
        ("right_of_way", B), ("right_of_way_after", F),  # [s]
        ("field", B), ("field_margin", F), ("stop_samples", I), ("swing", F), ("far", F), ("field_range", F),
        ("action_type", I), ("one_shot", B), ("collision_ends", B), ("max_steps", np.int64),
    ],
    align=True,
)  # fmt: skip

# Parameters for which all kinds of robots have the largest value: the size assumed of unknown robots, and search ranges
LARGEST = ("widest", "widest_length", "widest_width", "pair_range", "field_range", "stop_samples")
VIEWED = ("x", "y", "goal_x", "goal_y", "cos", "sin", "speed", "steer")  # a robot's entries of the global view
ACTION_TYPES = ("discrete", "continuous", "raw")
GAP_HORIZON = 0.5  # [m] up to which gaps between robots are measured


def every_kind(config: EnvConfig, cell: float, bodies: Sequence[RobotSpec] | None = None) -> NDArray[Any]:
    """Return the parameters of the kinds of robots, PARAMETERS[K].

    bodies: true bodies for the length and width scales, if the config's are enlarged for errors.
    """
    kinds = [_parameters_of_one(config, robot, cell) for robot in config.kinds]
    p = np.concatenate(kinds)
    p["kind"] = np.arange(len(kinds))
    for record, body in zip(p, bodies or config.kinds, strict=True):
        record["length_scale"], record["width_scale"] = body.longer, body.wider
    for name in LARGEST:
        p[name] = p[name].max()
    return p


def _parameters_of_one(config: EnvConfig, robot: RobotSpec, cell: float) -> NDArray[Any]:
    """Return PARAMETERS[1] of one kind of robots, regardless of the others."""
    sensor, traffic = config.sensor, config.traffic_spec
    p = np.zeros(1, dtype=PARAMETERS)
    half_length, half_width = robot.length / 2, robot.width / 2
    radius = float(np.hypot(half_length, half_width))
    fastest = max(robot.max_speed, -robot.min_speed)
    swing = (robot.rear_reach - half_length) * math.tan(robot.max_steering) / robot.wheelbase
    wide = math.hypot(1.0, swing)  # metres of the centre, at most, for each of the front axle
    stride = fastest * wide * config.time_step  # of the centre, at most, in one physics step
    far = robot.farthest
    dt = config.time_step / config.substeps
    blur = robot.max_acceleration * dt**2 / 8  # of a body from where it would be in a substep at even speed, at most
    stop = 0.5 * (fastest**2 / robot.max_acceleration + robot.max_acceleration * config.time_step**2)
    values = {
        "dt": dt, "time_step": config.time_step,
        "substeps": config.substeps, "repeat": config.action_repeat, "latency": latency_steps(config),
        "half_length": half_length, "half_width": half_width,
        "offset": robot.rear_reach - half_length, "radius": radius,
        "widest": radius, "widest_length": half_length, "widest_width": half_width,
        "wheelbase": robot.wheelbase, "min_speed": robot.min_speed, "max_speed": robot.max_speed,
        "max_acceleration": robot.max_acceleration,
        "max_steer": robot.max_steering, "max_steer_rate": robot.max_steering_rate,
        "arrival_radius": config.pose_radius if config.arrival == "pose" else config.arrival_radius,
        "pose_radius": config.pose_radius, "arrival_angle": config.pose_angle,
        "beyond": 0.0 if config.arrival == "pass" else np.inf,
        "near_miss_gap": config.near_miss_gap,
        "pair_range": 2 * radius + GAP_HORIZON + 2 * stride, "stride": stride, "blur": blur,
        "cell": cell, "lidar_range": sensor.lidar_range, "rays": sensor.rays, "neighbours": sensor.neighbours,
        "route_points": sensor.route_points, "route_spacing": sensor.route_spacing,
        "right_of_way": traffic.right_of_way, "right_of_way_after": traffic.right_of_way_after,
        "field": traffic.shield is not False, "field_margin": traffic.margin,
        "stop_samples": _stop_samples(config, robot), "swing": wide,
        "far": far,
        "field_range": 2 * (radius + stride + wide * stop) + traffic.margin,
        "action_type": ACTION_TYPES.index(config.action_type), "one_shot": config.tasks == "one_shot",
        "collision_ends": config.terminate_on_collision, "max_steps": config.max_steps,
    }  # fmt: skip
    for name, value in values.items():
        p[name] = value
    return p


def latency_steps(config: EnvConfig) -> int:
    """Return the physics steps between a command and its effect."""
    if config.traffic_spec.shield is not True:
        return 0
    return math.ceil(config.uncertainty_spec.bounds.latency / config.time_step - 1e-9)


def stop_samples(config: EnvConfig) -> int:
    """Return the most substeps of a motion under the shield: a physics step as commanded, then a full stop."""
    return max(_stop_samples(config, robot) for robot in config.kinds)


def _stop_samples(config: EnvConfig, robot: RobotSpec) -> int:
    fastest = max(robot.max_speed, -robot.min_speed)
    return (math.ceil(fastest / (robot.max_acceleration * config.time_step)) + 2) * config.substeps


class State(NamedTuple):
    """Read-only views of the robots' state, [B, N] and trailing axes."""

    pose: NDArray[np.float32]  # [B, N, 3]: front axle x [m], y [m], heading [rad]
    speed: NDArray[np.float32]  # [m/s]
    steer: NDArray[np.float32]  # [rad], rear wheels
    goal: NDArray[np.int32]  # [B, N, 2]: cell (row, col)
    alive: NDArray[np.int8]  # 0 once a one-shot robot has arrived
    route_points: NDArray[np.int32]  # valid way-points of routes[B, N]
    route_position: NDArray[np.float32]  # [m] along the route
    goals: NDArray[np.int32]  # reached in this episode
    distance: NDArray[np.float64]  # [m] driven in this episode


class Events(NamedTuple):
    """Read-only views of the last env step's events, [B, N]."""

    progress: NDArray[np.float32]  # [m] along the route
    driven: NDArray[np.float32]  # [m] of the front axle, in any direction
    gap: NDArray[np.float32]  # smallest to another robot [m], at most GAP_HORIZON
    arrived: NDArray[np.int8]
    touching: NDArray[np.int8]
    hit_robot: NDArray[np.int32]  # contact episodes with robots that began; one for each robot of a pair
    hit_shelf: NDArray[np.int32]
    hit_person: NDArray[np.int32]
    near_miss: NDArray[np.int32]


def field_of(robots: NDArray[Any], name: str) -> NDArray[Any]:
    """Return the view of a field of ROBOT[...], in whichever record it is."""
    found: NDArray[Any] = robots[OWNER[name]][name]
    return found


def _columns(record: NDArray[Any], first: str, count: int) -> NDArray[Any]:
    """View `count` neighbouring fields of equal type of a record as a trailing axis."""
    view = record[first]
    return as_strided(view, (*view.shape, count), (*view.strides, view.itemsize))


def state_of(robots: NDArray[Any]) -> State:
    """Return the views of State onto the structured array [B, N]."""
    motion, on_route, task, totals = robots["motion"], robots["on_route"], robots["task"], robots["totals"]
    return State(
        _columns(motion, "x", 3), motion["speed"], motion["steer"], _columns(task, "goal_row", 2),
        task["alive"], on_route["points"], on_route["position"], totals["goals"], totals["distance"],
    )  # fmt: skip


def events_of(robots: NDArray[Any]) -> Events:
    """Return the views of Events onto the structured array [B, N]."""
    return Events(*(robots["events"][name] for name in Events._fields))


def goal_of(r: Any) -> tuple[int, int]:
    """Return the goal cell (row, column) of a robot."""
    return int(r["task"]["goal_row"]), int(r["task"]["goal_col"])


def global_view(robots: NDArray[Any], side: float, config: EnvConfig) -> NDArray[np.float32]:
    """Return float32[N * 8] of robots ROBOT[N] (see Simulator.global_state); side: the map's longer one [m]."""
    viewed: NDArray[np.float32] = np.stack([field_of(robots, name) for name in VIEWED], axis=-1)
    return (viewed / view_scales(side, config)).reshape(-1)


def view_scales(side: float, config: EnvConfig) -> NDArray[np.float32]:
    """Return float32[N, 8], by what the fields VIEWED are divided in `global_view`."""
    scales = [(*[side] * 4, 1.0, 1.0, robot.max_speed, robot.max_steering) for robot in config.robots]
    return np.array(scales, np.float32)


def most_near(robots: int, config: EnvConfig) -> int:
    """Return how many robots can be, or have just been, within near_miss_gap of one; bodies never overlap."""
    diagonal = max(math.hypot(robot.length, robot.width) for robot in config.kinds)
    reach = max(config.near_miss_gap, GAP_HORIZON) + 1.5 * diagonal  # around half of its own
    return max(1, min(robots - 1, math.ceil(math.pi * reach**2 / _least_area(config))))


def _least_area(config: EnvConfig) -> float:
    """Return the area [m^2] of the smallest body."""
    return min(robot.length * robot.width for robot in config.kinds)


def most_pairs(robots: int, reach: float, radius: float, config: EnvConfig) -> int:
    """Return how many pairs of robots can be within reach [m]; bodies never overlap."""
    area = math.pi * (reach + radius) ** 2 / _least_area(config)
    return max(1, min(robots * (robots - 1) // 2, robots * (math.ceil(area) // 2 + 1)))
