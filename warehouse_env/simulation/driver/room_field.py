"""The distance to room: the heuristic of a search for a place off others' paths (manoeuvre.py).

A body contains the disc of its width around its centre, whatever its heading. So the disc is off the paths no later
than the body, and its shortest way there, clear of shelves and standing bodies, is no longer than the body's.
Dijkstra's algorithm finds these ways on a square lattice of points around the robot (the holonomic-with-obstacles
heuristic of hybrid-state A*, Dolgov et al. 2010). A centre is within _SLACK of a lattice point, so the discs on points
are smaller by that. Lattice ways turn by eighths and are up to 8% longer than the disc's, within the weight of the
search (manoeuvre.GREED).

    write_room(pose, around, scratch)    around a Pose, into scratch.room float32[POINTS, POINTS] [m], rows northward
    room_at(x, y, x0, y0, room, apart_of(p))    the value at a body's centre (x, y) [m]; (x0, y0): the robot's
    write_way(x0, y0, room, p, way)             the way of descent, as bodies along it

Values: 0 off the paths, or at the rim, beyond which there may be room; BARRED in a shelf or a body; UNKNOWN without a
way. A field takes 0.15 ms, as much as a hundred nodes of a search.
"""

import numpy as np

from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, part
from warehouse_env.simulation.driver.bodies import (
    CENTRE_X,
    CENTRE_Y,
    COS,
    HALF_LENGTH,
    HALF_WIDTH,
    OFF,
    RADIUS,
    SIN,
    write_body,
)
from warehouse_env.simulation.driver.scratch import POINTS
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import square_at
from warehouse_env.simulation.physics.trigonometry import ZERO

# 81 POINTS each way are 8 m around the default body, farther than it knows of others (recovery.NEAR)
_APART = np.float32(2.0 / 3.0)  # of the disc's radius between two points: 0.2 m, so that an aisle has five abreast
_MIDDLE = POINTS // 2
BARRED, UNKNOWN = np.float32(np.inf), np.float32(1e9)
_DIAGONAL = np.float32(np.sqrt(2.0))
_SLACK = np.float32(np.sqrt(0.5))  # times as far as points are apart: how far a place may be from the nearest


@inline
def _radius(p):
    """Return the radius [m] of the disc."""
    return min(p["half_width"], p["half_length"])


@inline
def apart_of(p):
    """Return how far [m] two points are apart."""
    return _APART * _radius(p)


@inline
def _raise_near(body, wide, left, low, apart, value, room):
    """Raise points nearer than `wide` [m] to a body float32[BODY] to `value`; (left, low) [m]: the first point."""
    x, y, reach = body[CENTRE_X] - left, body[CENTRE_Y] - low, body[RADIUS] + wide
    for row in range(max(0, int((y - reach) / apart)), min(POINTS, int((y + reach) / apart) + 1)):
        for column in range(max(0, int((x - reach) / apart)), min(POINTS, int((x + reach) / apart) + 1)):
            dx, dy = np.float32(column) * apart - x, np.float32(row) * apart - y
            along = max(abs(dx * body[COS] + dy * body[SIN]) - body[HALF_LENGTH], ZERO)
            aside = max(abs(dy * body[COS] - dx * body[SIN]) - body[HALF_WIDTH], ZERO)
            if along * along + aside * aside < wide * wide:
                room[row, column] = max(room[row, column], value)


@inline
def _write_places(left, low, around, room):
    """Write what a disc on each point is in: BARRED in a shelf or a body, UNKNOWN on the paths, else 0."""
    avoid, bodies, p, apart = around.avoid, around.bodies, around.p, apart_of(around.p)
    slim = _radius(p) - _SLACK * apart
    square = slim * _SLACK  # half the side of the square in the disc: rectangles are what is held against shelves
    for row in range(POINTS):
        for column in range(POINTS):
            x, y = left + np.float32(column) * apart, low + np.float32(row) * apart
            shut = body_touches_shelf(square_at(x, y, square), around.floor)
            room[row, column] = BARRED if shut else ZERO
    for k in range(avoid.shape[0]):
        _raise_near(avoid[k], slim + OFF, left, low, apart, UNKNOWN, room)
    for k in range(bodies.shape[0]):
        _raise_near(bodies[k], slim, left, low, apart, BARRED, room)


@inline
def _begin(apart, room, keys, items):
    """Write how far points on the paths are from room beside them, and push them on the heap; return its size."""
    size = 0
    for row in range(POINTS):
        for column in range(POINTS):
            if room[row, column] != UNKNOWN:
                continue
            least = UNKNOWN
            if row == 0 or column == 0 or row == POINTS - 1 or column == POINTS - 1:
                least = ZERO
            else:
                for k in range(9):
                    if room[row + k // 3 - 1, column + k % 3 - 1] == ZERO:
                        least = min(least, apart if k % 2 else apart * _DIAGONAL)
            if least < UNKNOWN:
                room[row, column] = least
                size = push(keys, items, size, least, row * POINTS + column)
    return size


@inline
def _spread(size, apart, room, keys, items):
    """Dijkstra's algorithm: write the shortest way from the points on a heap of `size` to all that have a way.

    A point gets on the heap twice at most: by a neighbour across, and by one beside it, since none later is nearer.
    """
    while size > 0:
        cost, at, size = pop(keys, items, size)
        row, column = at // POINTS, at % POINTS
        if cost > room[row, column]:
            continue
        for k in range(9):
            r, c = row + k // 3 - 1, column + k % 3 - 1
            if r < 0 or c < 0 or r >= POINTS or c >= POINTS or room[r, c] == BARRED:
                continue
            total = cost + (apart if k % 2 else apart * _DIAGONAL)
            if total < room[r, c]:
                room[r, c] = total
                size = push(keys, items, size, total, r * POINTS + c)


@part
def write_room(pose, around, scratch):
    """Write how far [m] it is off `avoid`, past `bodies`, for points around the body at a Pose (see above)."""
    p, apart, room, heap = around.p, apart_of(around.p), scratch.room, scratch.queue
    x0, y0 = pose.x - p["offset"] * pose.c, pose.y - p["offset"] * pose.s
    left, low = x0 - np.float32(_MIDDLE) * apart, y0 - np.float32(_MIDDLE) * apart
    _write_places(left, low, around, room)
    _spread(_begin(apart, room, heap.keys, heap.items), apart, room, heap.keys, heap.items)


@inline
def room_at(x, y, x0, y0, room, apart):
    """Return how far [m] it is from (x, y): the least of the four points around it; 0 off the lattice, UNKNOWN or more
    where there is no way.
    """
    column, row = int(np.floor((x - x0) / apart)) + _MIDDLE, int(np.floor((y - y0) / apart)) + _MIDDLE
    if row < 0 or column < 0 or row >= POINTS - 1 or column >= POINTS - 1:
        return ZERO
    return min(min(room[row, column], room[row, column + 1]), min(room[row + 1, column], room[row + 1, column + 1]))


@part
def write_way(x0, y0, room, p, way):
    """Write bodies at every second point of the way of descent from (x0, y0) [m] to room, into way float32[K, BODY];
    return how many, K at most: 0 where there is no way, or room already.
    """
    apart, row, column, count = apart_of(p), _MIDDLE, _MIDDLE, 0
    for step in range(2 * way.shape[0]):
        if not ZERO < room[row, column] < UNKNOWN:
            break
        to_row, to_column = row, column
        for k in range(9):
            r, c = row + k // 3 - 1, column + k % 3 - 1
            if 0 <= r < POINTS and 0 <= c < POINTS and room[r, c] < room[to_row, to_column]:
                to_row, to_column = r, c
        dx, dy = np.float32(to_column - column), np.float32(to_row - row)
        row, column = to_row, to_column
        if step % 2 == 1:
            long = np.sqrt(dx * dx + dy * dy)
            x, y = x0 + np.float32(column - _MIDDLE) * apart, y0 + np.float32(row - _MIDDLE) * apart
            write_body(x, y, dx / long, dy / long, p, way[count])
            count += 1
    return count
