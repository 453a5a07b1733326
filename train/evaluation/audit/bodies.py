"""The gap between two bodies, or the depth of their overlap, by corners and edges.

The gap of two separate rectangles is the distance of a corner of one from the other. If they overlap, a corner of one
lies in the other, or an edge of one runs through the other.
"""

import math
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.kernel import inline, part

_NO_REACH = 1e-12  # [m] that an edge goes towards a side: it is parallel to it


class AuditBody(NamedTuple):
    """A robot's body, its limits, and how an env step is divided."""

    half_length: float  # [m]
    half_width: float  # [m]
    back: float  # [m] that the body's centre lies behind the fixed axle
    radius: float  # [m] of the circle around the body
    far: float  # [m] that the body reaches from the fixed axle, ahead or behind
    wheelbase: float  # [m]
    slowest: float  # [m/s]
    fastest: float  # [m/s]
    acceleration: float  # [m/s^2]
    steering: float  # [rad]
    steering_rate: float  # [rad/s]
    pieces: int  # arcs of an env step: its substeps
    piece: float  # [s]

    @classmethod
    def of(cls, config: EnvConfig, robot: RobotSpec) -> Self:
        """Return what a config says of robots of a kind."""
        return cls(
            robot.length / 2, robot.width / 2, robot.rear_reach - robot.length / 2,
            math.hypot(robot.length, robot.width) / 2, max(robot.rear_reach, robot.front_overhang), robot.wheelbase,
            robot.min_speed, robot.max_speed, robot.max_acceleration, robot.max_steering, robot.max_steering_rate,
            config.substeps * config.action_repeat, config.time_step / config.substeps,
        )  # fmt: skip


class Outline(NamedTuple):
    """A rectangle on the floor."""

    x: Any  # of its centre [m]
    y: Any
    c: Any  # cosine of its heading
    s: Any
    half_length: Any  # [m]
    half_width: Any


class AuditFleet(NamedTuple):
    """The bodies of all kinds of robots, and the kind of each robot."""

    bodies: tuple[AuditBody, ...]
    kinds: NDArray[np.int64]  # [N]
    radius: float  # [m] of the widest

    @classmethod
    def of(cls, config: EnvConfig) -> Self:
        """Return what a config says."""
        bodies = tuple(AuditBody.of(config, robot) for robot in config.kinds)
        return cls(bodies, np.array(config.kind_of), max(body.radius for body in bodies))


@inline
def body_of(i, fleet):
    """Return the body of robot i."""
    return fleet.bodies[fleet.kinds[i]]


@inline
def outline_of(centre, body):
    """Return the outline of a body at its centre's (x, y, cosine, sine); body: anything with half sides."""
    x, y, c, s = centre
    return Outline(x, y, c, s, body.half_length, body.half_width)


@inline
def point_gap(u, v, half_length, half_width):
    """Return how far [m] the point (u, v), seen from a rectangle's centre, is from it; inside, how deep, negative."""
    beyond, aside = abs(u) - half_length, abs(v) - half_width
    if beyond <= 0.0 or aside <= 0.0:
        return max(beyond, aside)
    return math.sqrt(beyond * beyond + aside * aside)


@inline
def _nearest_corner(u, v, c, s, length, width, half_length, half_width):
    """Return the least `point_gap` of the corners of a body at (u, v), turned by (c, s), from a rectangle."""
    a, b, p, q = length * c, length * s, width * s, width * c
    return min(
        point_gap(u + a - p, v + b + q, half_length, half_width),
        point_gap(u + a + p, v + b - q, half_length, half_width),
        point_gap(u - a - p, v - b + q, half_length, half_width),
        point_gap(u - a + p, v - b - q, half_length, half_width),
    )


@inline
def _between(middle, reach, half):
    """Return the part of an edge, from -1 to 1 along it, between two parallel sides at -half and half."""
    if abs(reach) < _NO_REACH:
        return (-1.0, 1.0) if abs(middle) < half else (1.0, -1.0)
    one, other = (-half - middle) / reach, (half - middle) / reach
    return max(min(one, other), -1.0), min(max(one, other), 1.0)


@inline
def _edge_gap(u, v, a, b, half_length, half_width):
    """Return the `point_gap` of the middle of the part of edge (u, v) -+ (a, b) inside a rectangle, else 0."""
    first, last = _between(u, a, half_length)
    enters, leaves = _between(v, b, half_width)
    first, last = max(first, enters), min(last, leaves)
    if first >= last:
        return 0.0
    middle = 0.5 * (first + last)
    return point_gap(u + middle * a, v + middle * b, half_length, half_width)


@part
def gap(one, other):
    """Return the gap [m] between two outlines; negative: the depth of the overlap.

    It changes no faster than any point of one moves relative to the other.
    """
    x, y, c, s, half_length, half_width = one
    to_x, to_y, other_c, other_s, other_length, other_width = other
    dx, dy = to_x - x, to_y - y
    turned_c, turned_s = c * other_c + s * other_s, c * other_s - s * other_c
    u, v = dx * c + dy * s, dy * c - dx * s
    back_u, back_v = -dx * other_c - dy * other_s, dx * other_s - dy * other_c
    found = min(
        _nearest_corner(u, v, turned_c, turned_s, other_length, other_width, half_length, half_width),
        _nearest_corner(back_u, back_v, turned_c, -turned_s, half_length, half_width, other_length, other_width),
    )
    most = max(half_length, half_width) + max(other_length, other_width)
    if u * u + v * v >= most * most:
        return found
    a, b, p, q = other_length * turned_c, other_length * turned_s, -other_width * turned_s, other_width * turned_c
    sides = min(_edge_gap(u + p, v + q, a, b, half_length, half_width),
                _edge_gap(u - p, v - q, a, b, half_length, half_width))  # fmt: skip
    ends = min(_edge_gap(u + a, v + b, p, q, half_length, half_width),
               _edge_gap(u - a, v - b, p, q, half_length, half_width))  # fmt: skip
    middle = point_gap(u, v, half_length, half_width)  # where one lies on the other, all corners and edges may touch
    inside = min(sides, ends, middle)
    return min(found, inside) if inside < 0.0 else found
