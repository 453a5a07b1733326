"""Reeds-Shepp curves: the shortest path between poses of a car that drives forwards and backwards, on open floor.

A curve is a word of two to five segments: arcs of the least turning radius to the left or to the right, and straight
lines, each forwards or backwards. Reeds and Shepp, "Optimal paths for a car that goes both forwards and backwards",
1990, give eleven words by formulas (8.1 to 8.11); the same car seen in time and in a mirror makes four of each. The
shortest curve of all is among these WORDS.

API, for any kernel (scalars, float64, pure): a goal seen from the start (`seen_from`) is `ahead`, `left` [m] and
`turn` [rad], counter-clockwise, and `radius` [m] is the least turning radius.

    distance(ahead, left, turn, radius)             length [m] of the shortest curve
    word(n, ahead, left, turn, radius)              (length, five signed lengths [m]) of word n, length inf: no such way
    TURNS[n, k] / radius                            curvature [1/m] of segment k of word n: 1 left, 0 straight, -1 right

    seen_from(x, y, heading, to_x, to_y, to_heading)  (ahead, left, turn)
    rolled(x, y, heading, length, curvature)        the pose at the end of a segment
"""

import math

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part

WORDS, SEGMENTS = 44, 5
_L, _R, _S = 1, -1, 0
# the segments of each family, for forwards and left first
_FAMILIES = (
    (_L, _S, _L), (_L, _S, _R), (_L, _R, _L), (_L, _R, _L), (_L, _R, _L, _R), (_L, _R, _L, _R), (_L, _R, _S, _L),
    (_L, _R, _S, _R), (_L, _S, _R, _L), (_R, _S, _R, _L), (_L, _R, _S, _L, _R),
)  # fmt: skip
_CSC, _CSD, _CCC, _CCC_BACK, _CCUC, _CUUC, _CCSC, _CCSD, _CSCC_BACK, _DSCC_BACK, _CCSCC = range(11)
_TINY = 1e-9  # [rad] by which rounding may make a segment negative

TURNS: NDArray[np.float64] = np.zeros((WORDS, SEGMENTS))
for _n in range(WORDS):
    _letters = _FAMILIES[_n >> 2]
    TURNS[_n, : len(_letters)] = [-letter if _n & 2 else letter for letter in _letters]
TURNS.flags.writeable = False

_QUARTER = 0.5 * math.pi
_NONE = (False, 0.0, 0.0, 0.0)


@inline
def wrapped(angle):
    """Return an angle [rad] from -pi up to, but not, pi."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@inline
def seen_from(x, y, heading, to_x, to_y, to_heading):
    """Return (ahead, left [m], turn [rad]) of a pose as seen from another."""
    s, c = math.sin(heading), math.cos(heading)
    dx, dy = to_x - x, to_y - y
    return dx * c + dy * s, dy * c - dx * s, wrapped(to_heading - heading)


@inline
def rolled(x, y, heading, length, curvature):
    """Return the pose (x, y, heading) at the end of an arc of a signed length [m] and a curvature [1/m]."""
    half = 0.5 * length * curvature
    chord = length * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), heading + 2.0 * half


@inline
def _middle_turns(u, v, xi, eta, turn):
    """Return the first and last arc around two middle ones of u and v [rad] (tau and omega of the paper)."""
    delta = wrapped(u - v)
    a, b = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    first = math.atan2(eta * a - xi * b, xi * a + eta * b)
    flipped = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0 < 0.0
    tau = wrapped(first + math.pi) if flipped else wrapped(first)
    return tau, wrapped(tau - u + v - turn)


@part
def _same_turns(family, x, y, s, c, turn):
    """Return (whether there is one, t, u, v) of the words whose first and last arcs turn alike."""
    xi, eta = x - s, y - 1.0 + c
    rho, theta = math.sqrt(xi * xi + eta * eta), math.atan2(eta, xi)
    if family == _CSC:  # 8.1
        v = wrapped(turn - theta)
        return theta >= -_TINY and v >= -_TINY, theta, rho, v
    if family in (_CCC, _CCC_BACK):  # 8.3 and 8.4
        if rho > 4.0:
            return _NONE
        u = -2.0 * math.asin(0.25 * rho)
        t = wrapped(theta + 0.5 * u + math.pi)
        return t >= -_TINY, t, u, wrapped(turn - t + u)
    if rho < 2.0:
        return _NONE
    root = math.sqrt(rho * rho - 4.0)  # 8.9
    t, u = wrapped(theta + math.atan2(root, -2.0)), 2.0 - root
    v = wrapped(turn - _QUARTER - t)
    return t >= -_TINY and u <= _TINY and v <= _TINY, t, u, v


@part
def _other_turns(family, x, y, s, c, turn):
    """Return (whether there is one, t, u, v) of the words whose first and last arcs turn apart."""
    xi, eta = x + s, y - 1.0 - c
    square = xi * xi + eta * eta
    if family == _CSD:  # 8.2
        if square < 4.0:
            return _NONE
        u = math.sqrt(square - 4.0)
        t = wrapped(math.atan2(eta, xi) + math.atan2(2.0, u))
        v = wrapped(t - turn)
        return t >= -_TINY and v >= -_TINY, t, u, v
    if family == _CCUC:  # 8.7
        rho = 0.25 * (2.0 + math.sqrt(square))
        if rho > 1.0:
            return _NONE
        u = math.acos(rho)
        t, v = _middle_turns(u, -u, xi, eta, turn)
        return t >= -_TINY and v <= _TINY, t, u, v
    if family == _CUUC:  # 8.8
        rho = (20.0 - square) / 16.0
        if rho < 0.0 or rho > 1.0:
            return _NONE
        u = -math.acos(rho)
        t, v = _middle_turns(u, u, xi, eta, turn)
        return t >= -_TINY and v >= -_TINY, t, u, v
    if square < 4.0:
        return _NONE
    if family == _CCSCC:  # 8.11
        u = 4.0 - math.sqrt(square - 4.0)
        t = wrapped(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
        v = wrapped(t - turn)
        return u <= _TINY and t >= -_TINY and v >= -_TINY, t, u, v
    t, u = math.atan2(xi, -eta), 2.0 - math.sqrt(square)  # 8.10
    v = wrapped(t + _QUARTER - turn)
    return t >= -_TINY and u <= _TINY and v <= _TINY, t, u, v


@inline
def _segments(family, t, u, v):
    """Return the five segments [rad] of a word from what its formula gives."""
    if family <= _CCC:
        return t, u, v, 0.0, 0.0
    if family == _CCC_BACK:
        return v, u, t, 0.0, 0.0
    if family == _CCUC:
        return t, u, -u, v, 0.0
    if family == _CUUC:
        return t, u, u, v, 0.0
    if family in (_CCSC, _CCSD):
        return t, -_QUARTER, u, v, 0.0
    if family == _CCSCC:
        return t, -_QUARTER, u, -_QUARTER, v
    return v, u, -_QUARTER, t, 0.0


@part
def _unit_word(n, x, y, s, c, turn):
    """Return what `word` does, for radius 1; s, c: sine and cosine of the turn."""
    family = n >> 2
    flip = -1.0 if n & 1 else 1.0  # what is driven forwards is driven backwards
    mirror = -1.0 if n & 2 else 1.0
    x, y, s, turn = x * flip, y * mirror, s * flip * mirror, turn * flip * mirror
    if family in (_CCC_BACK, _CSCC_BACK, _DSCC_BACK):
        x, y = x * c + y * s, x * s - y * c
    alike = family in (_CSC, _CCC, _CCC_BACK, _CCSC, _CSCC_BACK)
    if alike:
        found, t, u, v = _same_turns(family, x, y, s, c, turn)
    else:
        found, t, u, v = _other_turns(family, x, y, s, c, turn)
    if not found:
        return np.inf, 0.0, 0.0, 0.0, 0.0, 0.0
    p0, p1, p2, p3, p4 = _segments(family, t, u, v)
    length = abs(p0) + abs(p1) + abs(p2) + abs(p3) + abs(p4)
    return length, p0 * flip, p1 * flip, p2 * flip, p3 * flip, p4 * flip


@part
def word(n, ahead, left, turn, radius):
    """Return (length, five signed lengths [m]) of word n of WORDS; length inf: it leads to no such goal."""
    turn = wrapped(turn)
    length, p0, p1, p2, p3, p4 = _unit_word(n, ahead / radius, left / radius, math.sin(turn), math.cos(turn), turn)
    return length * radius, p0 * radius, p1 * radius, p2 * radius, p3 * radius, p4 * radius


@part
def distance(ahead, left, turn, radius):
    """Return the length [m] of the shortest curve."""
    turn = wrapped(turn)
    s, c, x, y = math.sin(turn), math.cos(turn), ahead / radius, left / radius
    least = np.inf
    for n in range(WORDS):
        least = min(least, _unit_word(n, x, y, s, c, turn)[0])
    return least * radius
