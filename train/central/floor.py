"""A body on an arc, exactly: where it is, and whether it keeps clear of the discs and its axle on the floor.

A piece of a route is (x, y, heading) where it begins, its rate (1 forwards, -1 backwards, 0 waits), its curvature and
its seconds, at unit speed. Lengths are in the floor's units.
"""

import math
from typing import Any, NamedTuple

from warehouse_env.kernel import inline, part
from warehouse_env.routes.reeds_shepp import rolled

_EDGE = 1e-9  # tolerance at the border
_RIGHT_ANGLE = 0.5 * math.pi


class CarBody(NamedTuple):
    """A rectangle about its rear axle."""

    ahead: float  # of the axle to the front
    behind: float  # of the axle to the tail
    half_width: float
    radius: float  # least turning radius

    @property
    def half_length(self) -> float:
        """Half of its length."""
        return 0.5 * (self.ahead + self.behind)


class CarFloor(NamedTuple):
    """The fixed obstacles, and the body that drives there."""

    width: float
    height: float
    discs: Any  # float64[K, 2]
    disc_radius: float
    half_length: float  # of the body
    half_width: float
    middle: float  # of the body, ahead of its axle
    circle: float  # radius of the circle around the body
    radius: float  # least turning radius
    turning_speed: float  # of the body's fastest point on the tightest arc at unit speed
    margin: float  # between bodies and to discs; at least half of it is certain


def floor_of(width: float, height: float, discs: Any, disc_radius: float, body: CarBody, margin: float) -> CarFloor:
    """Return the floor of these discs float64[K, 2] for this body."""
    half_length, middle = body.half_length, 0.5 * (body.ahead - body.behind)
    far = max(body.ahead, body.behind)
    return CarFloor(
        width, height, discs, disc_radius, half_length, body.half_width, middle,
        math.hypot(half_length, body.half_width), body.radius,
        math.hypot(body.radius + body.half_width, far) / body.radius, margin,
    )  # fmt: skip


@inline
def point_speed(rate, curvature, floor):
    """Return a bound of the speed of any point of a body on a piece."""
    return 0.0 if rate == 0.0 else (1.0 if curvature == 0.0 else floor.turning_speed)


@inline
def _on_floor(x, y, floor):
    """Return whether a point lies on the floor."""
    return -_EDGE <= x <= floor.width + _EDGE and -_EDGE <= y <= floor.height + _EDGE


@part
def stays_inside(x, y, heading, length, curvature, floor):
    """Return whether the axle stays on the floor along an arc of signed length.

    On a circle it is outermost at an end or due east, north, west or south of the centre.
    """
    to_x, to_y, _ = rolled(x, y, heading, length, curvature)
    if not (_on_floor(x, y, floor) and _on_floor(to_x, to_y, floor)):
        return False
    if curvature == 0.0:
        return True
    middle_x, middle_y = x - math.sin(heading) / curvature, y + math.cos(heading) / curvature
    dx, dy = x - middle_x, y - middle_y
    radius, angle, turn = math.sqrt(dx * dx + dy * dy), math.atan2(dy, dx), length * curvature
    first, last = min(angle, angle + turn), max(angle, angle + turn)
    for quarter in range(math.ceil(first / _RIGHT_ANGLE), math.floor(last / _RIGHT_ANGLE) + 1):
        at = quarter * _RIGHT_ANGLE
        if not _on_floor(middle_x + radius * math.cos(at), middle_y + radius * math.sin(at), floor):
            return False
    return True


@inline
def disc_gap(x, y, heading, disc_x, disc_y, floor):
    """Return the distance of a disc from a body; negative, and too small, if they overlap."""
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = disc_x - x, disc_y - y
    beyond = abs(dx * c + dy * s - floor.middle) - floor.half_length
    aside = abs(dy * c - dx * s) - floor.half_width
    if beyond <= 0.0 or aside <= 0.0:
        return max(beyond, aside) - floor.disc_radius
    return math.sqrt(beyond * beyond + aside * aside) - floor.disc_radius


@part
def off_discs(x, y, heading, length, curvature, floor):
    """Return whether a body keeps the margin from all discs along an arc (conservative advancement)."""
    way, rate = abs(length), 1.0 if length >= 0.0 else -1.0
    speed = point_speed(rate, curvature, floor)
    margin = floor.margin
    reach = floor.circle + floor.disc_radius + margin + 0.5 * speed * way
    mid_x, mid_y, mid_heading = rolled(x, y, heading, 0.5 * length, curvature)
    mid_x, mid_y = mid_x + floor.middle * math.cos(mid_heading), mid_y + floor.middle * math.sin(mid_heading)
    for k in range(floor.discs.shape[0]):
        disc_x, disc_y = floor.discs[k, 0], floor.discs[k, 1]
        if (disc_x - mid_x) ** 2 + (disc_y - mid_y) ** 2 > reach * reach:
            continue
        t = 0.0
        while True:
            at_x, at_y, at_heading = rolled(x, y, heading, rate * t, curvature)
            gap = disc_gap(at_x, at_y, at_heading, disc_x, disc_y, floor)
            if gap < margin:
                return False
            if t >= way:
                break
            t = min(way, t + max(gap - 0.5 * margin, 0.5 * margin) / speed)
    return True


@inline
def is_free(x, y, heading, length, curvature, floor):
    """Return whether an arc keeps the axle on the floor and the body off the discs."""
    return stays_inside(x, y, heading, length, curvature, floor) and off_discs(x, y, heading, length, curvature, floor)
