"""Exact contact and distance of oriented rectangles, by separating axes. Rectangles are tuples of scalars."""

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO, sin_cos


class Pose(NamedTuple):
    """Where a robot's front axle is [m], and its heading [rad] with its cosine and sine."""

    x: Any
    y: Any
    heading: Any
    c: Any
    s: Any


class Rectangle(NamedTuple):
    """A rectangle on the floor: its centre, cosine and sine of its heading, half its length and half its width [m]."""

    x: Any
    y: Any
    c: Any
    s: Any
    length: Any
    width: Any


@inline
def pose_at(x, y, heading):
    """Return the pose with a heading [rad]."""
    s, c = sin_cos(heading)
    return Pose(x, y, heading, c, s)


@inline
def body_at(x, y, c, s, p):
    """Return the body of a robot with parameters p, whose centre is at (x, y) [m]."""
    return Rectangle(x, y, c, s, p["half_length"], p["half_width"])


@inline
def body_of(x, y, c, s, p):
    """Return the body of a robot with parameters p, whose front axle is at (x, y) [m]."""
    return Rectangle(x - p["offset"] * c, y - p["offset"] * s, c, s, p["half_length"], p["half_width"])


@inline
def grown(one, margin):
    """Return a rectangle with `margin` [m] around it."""
    return Rectangle(one.x, one.y, one.c, one.s, one.length + margin, one.width + margin)


@inline
def square_at(x, y, half):
    """Return an axis-aligned square of side 2 x `half` [m]."""
    return Rectangle(x, y, ONE, ZERO, half, half)


@inline
def half_box(one):
    """Return half the width and half the height [m] of the axis-aligned box around a rectangle."""
    return one.length * abs(one.c) + one.width * abs(one.s), one.length * abs(one.s) + one.width * abs(one.c)


@inline
def squared_distance(one, other):
    """Return the squared distance [m^2] of two rectangles' centres."""
    dx, dy = other.x - one.x, other.y - one.y
    return dx * dx + dy * dy


@inline
def rectangles_touch(one, other):
    """Return whether two closed rectangles share a point."""
    dx, dy = other.x - one.x, other.y - one.y
    c = abs(one.c * other.c + one.s * other.s)
    s = abs(one.c * other.s - one.s * other.c)
    if abs(dx * one.c + dy * one.s) > one.length + other.length * c + other.width * s:
        return False
    if abs(dy * one.c - dx * one.s) > one.width + other.length * s + other.width * c:
        return False
    if abs(dx * other.c + dy * other.s) > other.length + one.length * c + one.width * s:
        return False
    return abs(dy * other.c - dx * other.s) <= other.width + one.length * s + one.width * c


@inline
def separation(one, other):
    """Return the widest gap [m] between two rectangles along an axis of either.

    It is positive where `rectangles_touch` is False, and then between 0.7 and 1 times their distance.
    """
    dx, dy = other.x - one.x, other.y - one.y
    c = abs(one.c * other.c + one.s * other.s)
    s = abs(one.c * other.s - one.s * other.c)
    return max(
        max(
            abs(dx * one.c + dy * one.s) - (one.length + other.length * c + other.width * s),
            abs(dx * other.c + dy * other.s) - (other.length + one.length * c + one.width * s),
        ),
        max(
            abs(dy * one.c - dx * one.s) - (one.width + other.length * s + other.width * c),
            abs(dy * other.c - dx * other.s) - (other.width + one.length * s + one.width * c),
        ),
    )


@inline
def squared_distance_to_box(px, py, half_length, half_width):
    """Return the squared distance [m^2] of a point, in the rectangle's own frame, to it; 0 inside."""
    ex = abs(px) - half_length
    ey = abs(py) - half_width
    ex = ex if ex > ZERO else ZERO
    ey = ey if ey > ZERO else ZERO
    return ex * ex + ey * ey


@inline
def squared_distance_to(x, y, one):
    """Return the squared distance [m^2] of a point to a rectangle; 0 inside."""
    dx, dy = x - one.x, y - one.y
    return squared_distance_to_box(dx * one.c + dy * one.s, dy * one.c - dx * one.s, one.length, one.width)


@inline
def _nearest_corner(one, other):
    """Return the smallest squared distance [m^2] of the other rectangle's corners to the one."""
    dx, dy = other.x - one.x, other.y - one.y
    x = dx * one.c + dy * one.s
    y = dy * one.c - dx * one.s
    c = one.c * other.c + one.s * other.s
    s = one.c * other.s - one.s * other.c
    lx, ly = other.length * c, other.length * s
    wx, wy = -other.width * s, other.width * c
    return min(
        min(
            squared_distance_to_box(x + lx + wx, y + ly + wy, one.length, one.width),
            squared_distance_to_box(x + lx - wx, y + ly - wy, one.length, one.width),
        ),
        min(
            squared_distance_to_box(x - lx + wx, y - ly + wy, one.length, one.width),
            squared_distance_to_box(x - lx - wx, y - ly - wy, one.length, one.width),
        ),
    )


@inline
def rectangle_gap(one, other):
    """Return the distance [m] between two rectangles, 0 where they touch.

    Disjoint convex polygons are nearest at a corner of one of them.
    """
    if rectangles_touch(one, other):
        return ZERO
    return np.sqrt(min(_nearest_corner(one, other), _nearest_corner(other, one)))


@inline
def ray_to_rectangle(ox, oy, ux, uy, half_length, half_width):
    """Return the distance along a ray (unit vector u from o, in the rectangle's own frame) to it, or inf.

    Slabs without branches; a ray that starts inside returns 0. 0/0 gives nan, which no comparison takes.
    """
    ax = (-half_length - ox) / ux
    bx = (half_length - ox) / ux
    ay = (-half_width - oy) / uy
    by = (half_width - oy) / uy
    near_x = ax if ax < bx else bx
    far_x = bx if ax < bx else ax
    near_y = ay if ay < by else by
    far_y = by if ay < by else ay
    near = near_x if near_x > near_y else near_y
    far = far_x if far_x < far_y else far_y
    near = near if near > ZERO else ZERO
    return near if near <= far else np.float32(np.inf)
