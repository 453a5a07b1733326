"""The true motion of robots whose localisation and actuators err.

Rules, path follower and shield work on the *planned* motion in ROBOT as if it were exact. Each body follows the plan of
its robot, steered back to it by its believed pose. Contacts and outsiders depend on the true pose. A planned robot is
larger than its body and has narrower limits, by the declared errors of UncertaintySpec (`planned_config`). Within these
bounds no point of a body is farther than `tube` from its plan, so what holds for planned robots holds for bodies
(tube-based control: Langson, Chryssochoos, Rakovic and Mayne 2004).

Odometry is exact. Localisation corrects the believed pose by a share per metre, so nothing drifts while a robot stands.
A robot that believes to be farther off its plan than the bounds allow brakes, and plans from its believed pose once it
stands. So beyond the bounds it drives in jerks, and contacts are possible.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.kernel import inline, kernel
from warehouse_env.simulation.draws import DRIFT, ERROR, fraction, words
from warehouse_env.simulation.physics import contact
from warehouse_env.simulation.physics.contact import SPEED, STEER, X, Y
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO, sin_cos, wrap
from warehouse_env.simulation.state import MOTION

F = np.float32
BODY = np.dtype(
    [
        ("motion", MOTION),
        ("error_x", F), ("error_y", F), ("error_heading", F),  # of the believed pose [m], [rad]
    ],
    align=True,
)  # fmt: skip
POSE_X, POSE_Y, POSE_HEADING, ACCELERATING, STEERING = range(5)  # columns of errors
ERRORS = 5
OFF_PLAN = 0.03  # [m] that a point of a body may seem to be off its plan
_RESERVE, _LESS_STEERING = 0.02, 0.05  # shares of the limits that are kept for steering back, beside all errors
_DRIFT, _PERIOD = 0.7, 20.0  # share of an error that drifts, the rest is new each step; [s] to drift through all of it
_TRUSTS = 0.5  # [m] of its way after which a robot believes its localisation, as much as to 1 - 1/e
_PER_METRE = np.float32(1.0 / _TRUSTS)
_STIFF = np.float32(3.0)  # [1/m]: of what a body is aside, a way of 1 / _STIFF leaves 2/e
_CATCH_UP = np.float32(2.0)  # [1/s], along the way
_TWO = np.float32(2.0)
_HOLDS = np.float32(0.02)  # [m/s] from which brakes stop a body despite actuation errors


def errs(config: EnvConfig) -> bool:
    """Return whether poses or actuators err, or are declared to."""
    spec = config.uncertainty_spec
    return spec.errs or (bool(config.traffic_spec.shield) and spec.bounds.errs)


def tube(config: EnvConfig, robot: RobotSpec) -> float:
    """Return the farthest [m] that any point of a robot's body is off its plan within the declared bounds."""
    spec = config.uncertainty_spec.bounds
    return spec.pose_error + (robot.farthest + _TRUSTS) * spec.heading_error + OFF_PLAN


def planned_config(config: EnvConfig) -> EnvConfig:
    """Return the config of planned robots: larger by the tube, with limits that leave room to steer back."""
    if not (errs(config) and config.traffic_spec.shield):
        return config
    parts = tuple(replace(part, robot=_planned(config, part.robot)) for part in config.fleet)
    return config.replace(robot=_planned(config, config.robot), fleet=parts)


def _planned(config: EnvConfig, robot: RobotSpec) -> RobotSpec:
    """Return a robot as planned."""
    wide = tube(config, robot)
    most = 1.0 - config.uncertainty_spec.bounds.actuation_error - _RESERVE
    return replace(
        robot, length=robot.length + 2 * wide, width=robot.width + 2 * wide,
        front_overhang=robot.front_overhang + wide, max_speed=robot.max_speed * (1 - _RESERVE),
        min_speed=robot.min_speed * (1 - _RESERVE), max_acceleration=robot.max_acceleration * most,
        max_steering=robot.max_steering * (1 - _LESS_STEERING), max_steering_rate=robot.max_steering_rate * most,
    )  # fmt: skip


class Walk(NamedTuple):
    """How errors change from one physics step to the next."""

    pace: float  # of a walk by even steps
    bounds: NDArray[np.float32]  # [ERRORS] [m], [rad], shares
    drift: NDArray[np.float64]  # [B, N, ERRORS], -1 to 1


class Deviation(NamedTuple):
    """The robots that err, and their errors in the next env step.

    The errors are of the believed x, y [m] and heading [rad] after each physics step, and of acceleration and steering
    in it, as shares. Each drifts within its bound, and jitters.
    """

    bodies: NDArray[Any]  # BODY[B, N]
    errors: NDArray[np.float32]  # [B, repeat, N, ERRORS]
    walk: Walk


def deviation_of(config: EnvConfig, worlds: int) -> Deviation:
    """Return arrays for the robots of so many worlds; none of robots that do not err."""
    spec = config.uncertainty_spec
    aside = spec.pose_error / math.sqrt(2.0)
    bounds = (aside, aside, spec.heading_error, spec.actuation_error, spec.actuation_error)
    shape = (worlds, config.num_agents if errs(config) else 0)
    pace = math.sqrt(3.0 * config.time_step / _PERIOD)
    walk = Walk(pace, np.array(bounds, dtype=F), np.zeros((*shape, ERRORS)))
    return Deviation(np.zeros(shape, BODY), np.zeros((worlds, config.action_repeat, shape[1], ERRORS), F), walk)


@kernel
def begin_errors(world, keys, walk, bodies, robots):
    """Begin an episode of bodies BODY[B, N] with errors drawn anew, by the world's robots ROBOT[N].

    The robots are where they believe to be, and their bodies a little off. keys: of the Draws; walk: a Walk.
    """
    for i in range(robots.shape[0]):
        error, drift = bodies[world, i], walk.drift[world, i]
        for number in range(ERRORS):
            word, _, _, _ = words(keys[world], DRIFT, i, 0, number)
            drift[number] = 2.0 * fraction(word) - 1.0
        error["error_x"] = np.float32(_DRIFT * drift[POSE_X] * walk.bounds[POSE_X])
        error["error_y"] = np.float32(_DRIFT * drift[POSE_Y] * walk.bounds[POSE_Y])
        error["error_heading"] = np.float32(_DRIFT * drift[POSE_HEADING] * walk.bounds[POSE_HEADING])
    place_bodies(bodies[world], robots)


@kernel
def draw_errors(begin, end, keys, steps, walk, errors):
    """Draw the errors of an env step of the worlds from `begin` to before `end`.

    keys: of the Draws; steps int64[B]: since the resets; walk: a Walk; errors: see Deviation.
    """
    repeats = errors.shape[1]
    for b in range(begin, end):
        for repeat, i, error in np.ndindex(errors.shape[1:]):
            way, jitter, _, _ = words(keys[b], ERROR, i, steps[b] * repeats + repeat, error)
            drifted = walk.drift[b, i, error] + walk.pace * (2.0 * fraction(way) - 1.0)
            if abs(drifted) > 1.0:
                drifted = (2.0 if drifted > 0.0 else -2.0) - drifted
            walk.drift[b, i, error] = drifted
            share = _DRIFT * drifted + (1.0 - _DRIFT) * (2.0 * fraction(jitter) - 1.0)
            errors[b, repeat, i, error] = share * walk.bounds[error]


@kernel
def place_bodies(bodies, robots):
    """Place bodies BODY[N] as their robots ROBOT[N] were put."""
    for i in range(bodies.shape[0]):
        r, body = robots[i], bodies[i]
        motion = r["motion"]
        body["motion"]["x"], body["motion"]["y"] = motion["x"] - body["error_x"], motion["y"] - body["error_y"]
        body["motion"]["heading"] = wrap(motion["heading"] - body["error_heading"])
        body["motion"]["sin"], body["motion"]["cos"] = sin_cos(body["motion"]["heading"])
        body["motion"]["speed"], body["motion"]["steer"] = motion["speed"], motion["steer"]


@inline
def _off(x, y, heading, c, s, body):
    """Return (metres ahead, metres to the left, angle [rad]) by which a body seems to be off a planned pose."""
    dx, dy = body["motion"]["x"] + body["error_x"] - x, body["motion"]["y"] + body["error_y"] - y
    return dx * c + dy * s, dy * c - dx * s, wrap(body["motion"]["heading"] + body["error_heading"] - heading)


@inline
def _back_to_plan(r, body, next_speed, next_steer, p):
    """Return (speed [m/s], steering [rad]) that brings a body back to its plan, critically damped over the distance."""
    motion = r["motion"]
    if next_speed == ZERO:
        return ZERO, next_steer
    ahead, aside, turned = _off(motion["x"], motion["y"], motion["heading"], motion["cos"], motion["sin"], body)
    forward = ONE if next_speed > ZERO else -ONE
    bend = -_STIFF * (_STIFF * aside + forward * _TWO * turned)
    _, c = sin_cos(next_steer)
    speed = next_speed - _CATCH_UP * ahead
    return (max(speed, ZERO) if next_speed > ZERO else min(speed, ZERO)), next_steer - bend * p["wheelbase"] * c * c


@inline
def _changed(value, wanted, error, most, p):
    """Return the rate that takes a value to the wanted one in a physics step, with the actuator's error."""
    rate = min(max((wanted - value) / p["time_step"], -most), most)
    return min(max(rate * (ONE + error), -most), most)


@inline
def load(robots, bodies, planned, errors, own, params, kinds, floor):
    """Load the bodies and their commands of this physics step into `own`; planned: where their robots will be.

    bodies: BODY[N]; planned, own: float32[MOTION, N]; errors: float32[N, ERRORS]; params, kinds: of the bodies.
    """
    for i in range(robots.shape[0]):
        body, p = bodies[i], kind_of(i, params, kinds)
        speed, steer = _back_to_plan(robots[i], body, planned[SPEED, i], planned[STEER, i], p)
        motion = body["motion"]
        stops = speed == ZERO and abs(motion["speed"]) <= _HOLDS
        error = ZERO if stops else errors[i, ACCELERATING]
        acceleration = _changed(motion["speed"], speed, error, p["max_acceleration"], p)
        steer_rate = _changed(motion["steer"], steer, errors[i, STEERING], p["max_steer_rate"], p)
        contact.load(bodies, i, acceleration, steer_rate, p, floor, own)


@inline
def plan(motion, flags, lanes, p, kinds):
    """Carry out the planned motion float32[MOTION, N] of a physics step without contacts."""
    for _ in range(p["substeps"]):
        contact.try_motion(motion, flags, lanes, p, kinds)
        for i in range(motion.shape[1]):
            for k in range(5):
                motion[X + k, i] = motion[contact.TRY_X + k, i]


@inline
def _localise(body, dx, dy, errors):
    """Update the believed pose after a move (dx, dy) [m]: exact odometry, then the correction by localisation."""
    s, c = sin_cos(body["error_heading"])
    body["error_x"] += c * dx - s * dy - dx
    body["error_y"] += s * dx + c * dy - dy
    trust = min(np.sqrt(dx * dx + dy * dy) * _PER_METRE, ONE)
    body["error_x"] += trust * (errors[POSE_X] - body["error_x"])
    body["error_y"] += trust * (errors[POSE_Y] - body["error_y"])
    body["error_heading"] += trust * (errors[POSE_HEADING] - body["error_heading"])


@inline
def _replan_here(r, body):
    """Plan from the body's believed pose."""
    motion = r["motion"]
    motion["x"], motion["y"] = body["motion"]["x"] + body["error_x"], body["motion"]["y"] + body["error_y"]
    motion["heading"] = wrap(body["motion"]["heading"] + body["error_heading"])
    motion["sin"], motion["cos"] = sin_cos(motion["heading"])
    motion["speed"], motion["steer"] = body["motion"]["speed"], body["motion"]["steer"]
    r["shield"]["off_plan"] = 0


@inline
def store(robots, bodies, planned, errors, own, guarded, p, kinds):
    """Write a physics step back into robots and bodies, and mark robots off their plans."""
    for i in range(robots.shape[0]):
        motion = bodies[i]["motion"]
        _localise(bodies[i], own[X, i] - motion["x"], own[Y, i] - motion["y"], errors[i])
    contact.store(robots, planned)
    contact.store(bodies, own)
    for i in range(robots.shape[0]):
        r, body = robots[i], bodies[i]
        motion, shield = r["motion"], r["shield"]
        ahead, aside, turned = _off(motion["x"], motion["y"], motion["heading"], motion["cos"], motion["sin"], body)
        if np.sqrt(ahead * ahead + aside * aside) + kind_of(i, p, kinds)["far"] * abs(turned) > OFF_PLAN:
            shield["off_plan"] = 1
        if shield["off_plan"] != 0 and (
            guarded is None or (motion["speed"] == ZERO and body["motion"]["speed"] == ZERO)
        ):
            _replan_here(r, body)
