"""Standing bodies that a manoeuvre (manoeuvre.py) drives around, or moves away from."""

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.driver.scratch import BODY as BODY  # columns
from warehouse_env.simulation.physics.footprint import sweep_is_free
from warehouse_env.simulation.physics.geometry import (
    Rectangle,
    body_of,
    grown,
    rectangles_touch,
    separation,
    squared_distance,
)
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, sin_cos

# Columns of bodies float32[K, BODY]: the centre [m], cosine and sine of the heading, half length, half width and half
# diagonal [m].
CENTRE_X, CENTRE_Y, COS, SIN, HALF_LENGTH, HALF_WIDTH, RADIUS = range(7)
OFF = np.float32(0.2)  # [m] around a retreating body: more than right of way keeps (reservations.WIDE, of both)
_BERTH = np.float32(4.0)  # times the margin to shelves, which never move
_GIVEN = np.float32(0.002)  # [m] nearer than at the start that another body may come, as arcs are not driven exactly,
_SPARE = np.float32(0.001)  # [m] but not so near that the field stops it, where there is so much room,
_ROUNDING = np.float32(2e-5)  # [m] or as at the start: beside a body it may drive along it
_STEP, _STEP_NEAR = np.float32(0.12), np.float32(0.003)  # [m] from a body beyond which its distance is coarse; between
# poses near it: the gap that the widest axis shows can shrink and grow again within centimetres


class SearchArea(NamedTuple):
    """Obstacles of a search, and the searching robot's own body."""

    bodies: Any  # float32[K, BODY], standing obstacles
    rooms: Any  # float32[K] [m], distance kept from each of them (write_rooms)
    avoid: Any  # float32[L, BODY], bodies that the end pose must be off, if the goals are OFF or FAR_OFF
    floor: Any
    metric: Any  # float32[HEADINGS, SIDE, SIDE] [s], the turning metric of its kind (turning.py)
    p: Any  # PARAMETERS of its kind


@inline
def write_body(x, y, c, s, p, body):
    """Write a body with its centre at (x, y) [m], heading (c, s), and of the size of a robot with parameters p."""
    body[CENTRE_X], body[CENTRE_Y], body[COS], body[SIN] = x, y, c, s
    body[HALF_LENGTH], body[HALF_WIDTH], body[RADIUS] = p["half_length"], p["half_width"], p["radius"]


@inline
def write_robot(r, p, body):
    """Write the body of a ROBOT where it is; p: its parameters."""
    motion = r["motion"]
    x, y = motion["x"] - p["offset"] * motion["cos"], motion["y"] - p["offset"] * motion["sin"]
    write_body(x, y, motion["cos"], motion["sin"], p, body)


@inline
def _rectangle(body):
    return Rectangle(body[CENTRE_X], body[CENTRE_Y], body[COS], body[SIN], body[HALF_LENGTH], body[HALF_WIDTH])


@inline
def bars(pose, around):
    """Whether the body at a Pose, grown by OFF, touches one of the bodies `avoid`."""
    avoid, p = around.avoid, around.p
    own = grown(body_of(pose.x, pose.y, pose.c, pose.s, p), OFF)
    for k in range(avoid.shape[0]):
        reach, other = p["radius"] + avoid[k, RADIUS] + OFF + OFF, _rectangle(avoid[k])
        if squared_distance(own, other) < reach * reach and rectangles_touch(own, other):
            return True
    return False


@inline
def write_rooms(start, margin, around):
    """Write the distance [m] to keep from each body: the field's and `margin`, or less if the start is nearer."""
    bodies, rooms, p = around.bodies, around.rooms, around.p
    own = body_of(start.x, start.y, start.c, start.s, p)
    field = p["field_margin"] if p["field"] != 0 else ZERO
    for k in range(bodies.shape[0]):
        apart = separation(own, _rectangle(bodies[k]))
        rooms[k] = min(field + _BERTH * margin, max(apart - _GIVEN, min(apart - _ROUNDING, field + _SPARE)))


@inline
def _spare(x, y, c, s, around):
    """Return how much further [m] the body at an axle pose is off each of the bodies, at least, than its room."""
    bodies, rooms, p = around.bodies, around.rooms, around.p
    own = body_of(x, y, c, s, p)
    least = np.float32(np.inf)
    for k in range(bodies.shape[0]):
        other = _rectangle(bodies[k])
        apart = np.sqrt(squared_distance(own, other)) - p["radius"] - bodies[k, RADIUS]
        if apart < rooms[k] + _STEP:
            apart = separation(own, other)
        least = min(least, apart - rooms[k])
    return least


@inline
def _clear_of_bodies(start, bend, length, around):
    """Whether the body keeps its `rooms` from standing bodies along an arc; the start pose is not checked.

    Each step is as long as no point of the body can use up the spare distance, and at least _STEP_NEAR.
    """
    if around.bodies.shape[0] == 0:
        return True
    x, y, c, s = start.x, start.y, start.c, start.s
    left, sign = abs(length), ONE if length > ZERO else -ONE
    spare = _spare(x, y, c, s, around)
    while left > ZERO:
        step = min(max(spare / (ONE + around.p["far"] * abs(bend)), _STEP_NEAR), left)
        left -= step
        half_s, half_c = sin_cos(HALF * sign * step * bend)
        x += sign * step * (c * half_c - s * half_s)
        y += sign * step * (s * half_c + c * half_s)
        turn_s, turn_c = half_s * half_c + half_s * half_c, half_c * half_c - half_s * half_s
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
        spare = _spare(x, y, c, s, around)
        if spare < ZERO:
            return False
    return True


@inline
def arc_is_free(start, bend, length, margin, around):
    """Whether the body keeps `margin` [m] from shelves and its `rooms` from bodies along an arc from a Pose.

    bend [1/m]: curvature; length [m]: negative backwards. The start pose is not checked.
    """
    free = sweep_is_free(start, bend, length, margin, around.p, around.floor)
    return free and _clear_of_bodies(start, bend, length, around)
