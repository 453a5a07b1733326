"""The robot's body on the floor: does it, or its sweep along an arc, touch a shelf?"""

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.discs import meets_disc, reached_rows, touches_disc
from warehouse_env.simulation.physics.floor import FINE, UNIT
from warehouse_env.simulation.physics.geometry import Rectangle, body_of, grown, half_box, rectangles_touch, square_at
from warehouse_env.simulation.physics.kinematics import arc_end
from warehouse_env.simulation.physics.sweep import Sweep, touches_cell
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, sin_cos

_FINE = np.float32(FINE)
_UNIT = np.float32(UNIT)
_THIRD = np.float32(1.0 / 3.0)
_TWO_THIRDS = np.float32(2.0 / 3.0)
_SWEEP_STEP = np.float32(0.12)  # [m] of the front axle between two checked poses, on a gentle arc
_SWEEP_TURN = np.float32(0.06)  # [rad] between two checked poses, on a sharp one; less if the margin is narrow,
_TURN_PER_MARGIN = np.float32(1.25)  # [rad/m] so that no corner passes another deeper than half the margin,
_LEAST_TURN = np.float32(0.001)  # [rad] but at least this
_ROUNDED = np.float32(1e-5)  # [m], more than the rounding of poses


@inline
def cell_at(x, cell, count):
    """Return which of `count` cells of a side [m] holds a coordinate [m], or is nearest to it."""
    return min(max(int(x / cell), 0), count - 1)


@inline
def clearance_at(x, y, floor):
    """Return a lower bound of the distance [m] from a point to the nearest shelf, 0 outside the map."""
    if x < ZERO or y < ZERO:
        return ZERO
    clearance, scale = floor.clearance, _FINE / floor.cell
    row = int(y * scale)
    column = int(x * scale)
    if not (0 <= row < clearance.shape[0] and 0 <= column < clearance.shape[1]):
        return ZERO
    return np.float32(clearance[row, column]) * _UNIT


@inline
def body_touches_shelf(body, floor):
    """Return whether a closed Rectangle touches a shelf, the rim or a disc.

    Three discs that cover the body settle most cases by the clearance field; the rest is exact.
    """
    return disc_room(body, floor) <= ZERO and meets_obstacle(body, floor)


@inline
def meets_obstacle(body, floor):
    """Return the same as `body_touches_shelf`, without the clearance field."""
    return meets_cell(body, floor) or meets_disc(body, floor, floor.discs)


@inline
def touches_obstacle(body, way, between, p, floor):
    """Whether a robot's body touches a shelf, the rim or a disc at the end of a motion or, if asked, on the way.

    body: its Sweep; way: the longest path of any point of it [m].
    """
    return touches_cell(body, way, between, p, floor.solid) or touches_disc(body, way, between, p, floor, floor.discs)


@inline
def meets_cell(body, floor):
    """Return whether a closed Rectangle touches a cell of a shelf or the rim."""
    (ex, ey), solid, cell, half = half_box(body), floor.solid, floor.cell, HALF * floor.cell
    rows, columns = solid.shape
    first_row, last_row = reached_rows(body.y - ey, body.y + ey, rows, cell)
    first_column, last_column = reached_rows(body.x - ex, body.x + ex, columns, cell)
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            if solid[row, column] != 0:
                x, y = (np.float32(column) - HALF) * cell, (np.float32(row) - HALF) * cell
                if rectangles_touch(body, square_at(x, y, half)):
                    return True
    return False


@inline
def body_room(body, floor):
    """Return a distance [m] that any point of a body can move without touching a shelf; unknown if not positive."""
    room = clearance_at(body.x, body.y, floor) - np.sqrt(body.length * body.length + body.width * body.width)
    return room if room > ZERO else disc_room(body, floor)


@inline
def disc_room(body, floor):
    """Return the room [m] as `body_room`, for a body near shelves: that of three discs that cover it."""
    third = body.length * _THIRD
    shift = body.length * _TWO_THIRDS
    nearest = min(
        clearance_at(body.x, body.y, floor),
        clearance_at(body.x + shift * body.c, body.y + shift * body.s, floor),
        clearance_at(body.x - shift * body.c, body.y - shift * body.s, floor),
    )
    return nearest - np.sqrt(third * third + body.width * body.width)


@part
def _is_clear(start, bend, distance, margin, p, floor):
    """Return whether the body keeps `margin` [m] from shelves at every pose of the way, between samples as well.

    If it is nearer than that at the start, or as near within rounding, it must be off by the first sample.
    """
    count = int(abs(distance) * max(abs(bend) / _LEAST_TURN, ONE / _SWEEP_STEP)) + 1
    step = distance / np.float32(count)
    most = abs(step) * (ONE + p["far"] * abs(bend))
    x, y, heading = start.x, start.y, start.heading
    body = grown(body_of(x, y, start.c, start.s, p), margin)
    room, leaves = ZERO, body_touches_shelf(grown(body, _ROUNDED), floor)
    for _ in range(count):
        x, y, heading = arc_end(x, y, heading, step, bend)
        s, c = sin_cos(heading)
        before, body = body, grown(body_of(x, y, c, s, p), margin)
        room -= most
        if room > ZERO:
            continue
        room_before, room = max(room + most, ZERO), body_room(body, floor)
        between = room_before + max(room, ZERO) <= most and not leaves
        if (between or room <= ZERO) and touches_obstacle(Sweep(before, body, ZERO), most, between, p, floor):
            return False
        leaves = False
    return True


@inline
def sweep_is_free(start, bend, distance, margin, p, floor):
    """Return whether the body keeps `margin` [m] from shelves along an arc of curvature `bend` [1/m] from a Pose.

    `distance` [m] is signed (negative: backwards). The start is not checked: a robot that stands too close must be able
    to leave. Poses within the room of a checked one are free and skipped. Where the margin is so narrow that a corner
    could pass another between two poses, the way in between is checked, too.
    """
    if _TURN_PER_MARGIN * margin < _LEAST_TURN and not _is_clear(start, bend, distance, margin, p, floor):
        return False
    x, y, c, s = start.x, start.y, start.c, start.s
    half_length = p["half_length"] + margin
    half_width = p["half_width"] + margin
    step = _SWEEP_STEP
    turn = min(max(_TURN_PER_MARGIN * margin, _LEAST_TURN), _SWEEP_TURN)
    if abs(bend) * step > turn:
        step = turn / abs(bend)
    count = int(abs(distance) / step) + 1
    step = distance / np.float32(count)
    turn_s, turn_c = sin_cos(step * bend)
    half_s, half_c = sin_cos(HALF * step * bend)
    most = abs(step) * (ONE + (abs(p["offset"]) + half_length) * abs(bend))  # that any point moves from pose to pose
    room = ZERO
    for k in range(count):
        x += step * (c * half_c - s * half_s)
        y += step * (s * half_c + c * half_s)
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
        room -= most
        if room > ZERO:
            continue
        body = Rectangle(x - p["offset"] * c, y - p["offset"] * s, c, s, half_length, half_width)
        room = body_room(body, floor)
        if room > most * np.float32(count - 1 - k):
            return True
        if room <= ZERO and body_touches_shelf(body, floor):
            return False
    return True
