"""The motion within an env step, reconstructed in float64 from its two ends.

Speed and steering change linearly over a physics step, and a substep is an exact arc whose curvature is that of its
mean steering. So the ends of a step determine it, if it is one physics step and reaches no limit. Otherwise speed and
steering in the middle of the step are solved for.
"""

import math

from warehouse_env.kernel import inline, part

# Columns of arcs float64[N, pieces, ARC]: a piece's pose, its speed at the beginning, what changes it, its curvature.
X, Y, HEADING, COS, SIN, SPEED, ACCELERATION, BEND = range(8)
ARC = 8
STAND_X, STAND_Y, STAND_HEADING, STAND_SPEED, STAND_STEER = range(5)  # columns of states float64[B, N, 5]
STATE = 5

_EPSILON = 2.0**-23  # of float32, in which poses are kept
_ROUNDS = 6  # of Newton's method
_TINY = 1e-5  # [m/s], [rad] for its slopes


@inline
def rounding(extent, body):
    """Return a bound of the rounding error of a position [m] within an env step on a floor of this extent [m]."""
    return 2e-6 + _EPSILON * extent * (body.pieces + 1)


@inline
def wrapped(angle):
    """Return an angle [rad] between -pi and pi."""
    return angle - 2 * math.pi * math.floor(angle / (2 * math.pi) + 0.5)


@inline
def rolled(distance, c, s, bend):
    """Return (dx, dy, c, s): the way [m] along an arc of curvature `bend` [1/m] begun at heading (c, s), the new one.

    The way is the arc's chord, at the mean of both headings.
    """
    half = 0.5 * distance * bend
    half_c, half_s = math.cos(half), math.sin(half)
    chord = distance * (half_s / half if abs(half) > 1e-9 else 1.0)
    mean_c, mean_s = c * half_c - s * half_s, s * half_c + c * half_s
    return chord * mean_c, chord * mean_s, mean_c * half_c - mean_s * half_s, mean_s * half_c + mean_c * half_s


@inline
def body_at(arcs, i, t, body):
    """Return the centre's x, y [m], cosine and sine of robot i at t [s] within the step."""
    n = min(int(t / body.piece), body.pieces - 1)
    a = arcs[i, n]
    t -= n * body.piece
    distance = t * (a[SPEED] + 0.5 * t * a[ACCELERATION])
    dx, dy, c, s = rolled(distance, a[COS], a[SIN], a[BEND])
    return a[X] + dx - body.back * c, a[Y] + dy - body.back * s, c, s


@inline
def _between(first, knot, last, n, pieces):
    """Return the value at the start of piece n, linear to a knot in the middle and on to the end."""
    middle = pieces // 2
    if n <= middle and middle > 0:
        return first + (knot - first) * n / middle
    return knot + (last - knot) * (n - middle) / (pieces - middle)


@part
def lay(arc, before, after, speed, steer, body):
    """Write the pieces of a step with this speed [m/s] and steering [rad] in its middle; return its miss.

    arc float64[pieces, ARC]; before, after float64[STATE]. Returns (dx, dy [m], d heading [rad]) from its end to
    `after`.
    """
    x, y, heading = before[STAND_X], before[STAND_Y], before[STAND_HEADING]
    c, s = math.cos(heading), math.sin(heading)
    at_speed, at_steer = before[STAND_SPEED], before[STAND_STEER]
    for n in range(body.pieces):
        next_speed = _between(before[STAND_SPEED], speed, after[STAND_SPEED], n + 1, body.pieces)
        next_steer = _between(before[STAND_STEER], steer, after[STAND_STEER], n + 1, body.pieces)
        bend = -math.tan(0.5 * (at_steer + next_steer)) / body.wheelbase
        a = arc[n]
        a[X], a[Y], a[HEADING], a[COS], a[SIN] = x, y, heading, c, s
        a[SPEED], a[ACCELERATION], a[BEND] = at_speed, (next_speed - at_speed) / body.piece, bend
        distance = 0.5 * (at_speed + next_speed) * body.piece
        dx, dy, c, s = rolled(distance, c, s, bend)
        x, y, heading = x + dx, y + dy, heading + distance * bend
        at_speed, at_steer = next_speed, next_steer
    return after[STAND_X] - x, after[STAND_Y] - y, wrapped(after[STAND_HEADING] - heading)


@inline
def stand(arc, before):
    """Write the pieces of a step in which a robot stands."""
    for n in range(arc.shape[0]):
        a = arc[n]
        a[X], a[Y], a[HEADING] = before[STAND_X], before[STAND_Y], before[STAND_HEADING]
        a[COS], a[SIN] = math.cos(a[HEADING]), math.sin(a[HEADING])
        a[SPEED], a[ACCELERATION], a[BEND] = 0.0, 0.0, 0.0


@inline
def size(miss, body):
    """Return the largest error [m] of any point of the body for a pose that misses by (dx, dy, d heading)."""
    dx, dy, turn = miss
    return math.sqrt(dx * dx + dy * dy) + body.far * abs(turn)


@inline
def _slope(miss, other, scale, body):
    """Return the decrease of the three parts of a miss, times scale."""
    return (
        (miss[0] - other[0]) * scale, (miss[1] - other[1]) * scale, wrapped(miss[2] - other[2]) * scale * body.far,
    )  # fmt: skip


@inline
def _times(a, b):
    """Return the product of two vectors of three."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def solve(arc, before, after, slack, body):
    """Return the speed [m/s] and steering [rad] in the middle of a step that bring its end closest to `after`.

    Newton's method for least squares, in units of slack [m]. Each counts itself, too, in m/s and rad from the mean of
    both ends: what makes no difference, as steering does where a robot stands, stays there.
    """
    mean_speed = 0.5 * (before[STAND_SPEED] + after[STAND_SPEED])
    mean_steer = 0.5 * (before[STAND_STEER] + after[STAND_STEER])
    speed, steer, scale = mean_speed, mean_steer, 1.0 / (_TINY * slack)
    for _ in range(_ROUNDS):
        miss = lay(arc, before, after, speed, steer, body)
        by_speed = _slope(miss, lay(arc, before, after, speed + _TINY, steer, body), scale, body)
        by_steer = _slope(miss, lay(arc, before, after, speed, steer + _TINY, body), scale, body)
        off = miss[0] / slack, miss[1] / slack, miss[2] * body.far / slack
        a, b, c = _times(by_speed, by_speed) + 1.0, _times(by_speed, by_steer), _times(by_steer, by_steer) + 1.0
        p = _times(by_speed, off) + mean_speed - speed
        q = _times(by_steer, off) + mean_steer - steer
        speed += (p * c - q * b) / (a * c - b * b)
        steer += (q * a - p * b) / (a * c - b * b)
    return speed, steer


@inline
def top_speed(arc, body):
    """Return how fast [m/s] any point of the body is at the most in a step."""
    most = 0.0
    for n in range(body.pieces):
        a = arc[n]
        speed = max(abs(a[SPEED]), abs(a[SPEED] + a[ACCELERATION] * body.piece))
        across, along = 1.0 + abs(a[BEND]) * body.half_width, a[BEND] * body.far
        most = max(most, speed * math.sqrt(across * across + along * along))
    return most


@inline
def driven(arc, body):
    """Return the way [m] of the front axle in a step."""
    way = 0.0
    for n in range(body.pieces):
        way += abs(arc[n, SPEED] + 0.5 * arc[n, ACCELERATION] * body.piece) * body.piece
    return way
