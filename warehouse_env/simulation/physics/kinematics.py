"""Motion of a four-wheel, rear-steer, rear-drive robot; the pose is the centre of its fixed front axle.

Paper 000, eq. (2): dx = v cos b, dy = v sin b, db = w. At the fixed axle it holds exactly, with
w = -v tan(d) / L: the rear wheels turned left swing the tail right and the nose right.
"""

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, sin_cos, wrap

_SIXTH = np.float32(1.0 / 6.0)
_SMALL = np.float32(1e-3)  # [rad] under which sine and angle are the same in single precision
_OVER_120 = np.float32(1.0 / 120.0)


class Chassis(NamedTuple):
    """What a robot's motion depends on, as scalars, which loops over robots keep at hand."""

    wheelbase: Any  # [m]
    min_speed: Any  # [m/s]
    max_speed: Any  # [m/s]
    max_steer: Any  # [rad]


@inline
def chassis_of(p):
    """Return the Chassis of a record of PARAMETERS."""
    return Chassis(p["wheelbase"], p["min_speed"], p["max_speed"], p["max_steer"])


@inline
def approach(value, target, most):
    """Return `value` moved towards `target` by at most `most`."""
    if target > value + most:
        return value + most
    if target < value - most:
        return value - most
    return target


@inline
def curvature(steering, wheelbase):
    """Return the path's curvature [1/m], positive to the left, for a rear-wheel angle [rad]."""
    s, c = sin_cos(steering)
    return -s / (c * wheelbase)


@inline
def braking(speed, p):
    """Return the acceleration [m/s^2] of a physics step of full braking, which ends at rest at the latest."""
    return (approach(speed, ZERO, p["max_acceleration"] * p["time_step"]) - speed) / p["time_step"]


@inline
def way_driven(speed, next_speed, bend, far, dt):
    """Return at least the way [m] of any point of a body in a substep, and no more unless it turns back.

    bend: the curvature [1/m] of the axle's way; far: the farthest point [m] from the axle.
    """
    return HALF * dt * (abs(speed) + abs(next_speed)) * (ONE + far * abs(bend))


@inline
def roll(x, y, heading, distance, bend):
    """Return the pose (x, y, heading) after `distance` [m] on an arc of curvature `bend` [1/m].

    The front axle moves on the exact circle: the chord of the arc, not its tangent.
    """
    turn = distance * bend
    half = HALF * turn
    q = half * half
    chord = distance * (ONE - q * (_SIXTH - q * _OVER_120))  # sin(half) / half
    s, c = sin_cos(heading + half)
    return x + chord * c, y + chord * s, wrap(heading + turn)


@inline
def arc_end(x, y, heading, distance, bend):
    """Return what `roll` does, for a turn of any angle."""
    half = HALF * distance * bend
    s, c = sin_cos(heading + half)
    chord = distance if abs(half) < _SMALL else distance * (sin_cos(half)[0] / half)
    return x + chord * c, y + chord * s, wrap(wrap(heading + half) + half)


@inline
def next_motion(speed, steering, acceleration, steer_rate, chassis, dt):
    """Return the speed [m/s] and steering [rad] after `dt` [s] of a command [m/s^2], [rad/s], within the limits."""
    return (
        min(max(speed + acceleration * dt, chassis.min_speed), chassis.max_speed),
        min(max(steering + steer_rate * dt, -chassis.max_steer), chassis.max_steer),
    )


@inline
def arc_driven(speed, next_speed, steering, next_steering, chassis, dt):
    """Return the length [m] and curvature [1/m] of the arc of `dt` [s] in which speed and steering change linearly.

    The mean speed makes distances exact under constant acceleration.
    """
    return HALF * (speed + next_speed) * dt, curvature(HALF * (steering + next_steering), chassis.wheelbase)


@inline
def drive(pose, speed, next_speed, steering, next_steering, chassis, dt):
    """Return the pose (x, y, heading) at the end of `arc_driven`."""
    distance, bend = arc_driven(speed, next_speed, steering, next_steering, chassis, dt)
    x, y, heading = pose
    return roll(x, y, heading, distance, bend)
