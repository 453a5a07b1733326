"""Angles in float32 from + - * / alone, so that compiled and plain Python, and any machine, agree to the bit.

Taylor series on a reduced range; the remainders are below float32's resolution. Library functions
(libm, NumPy, LLVM) differ from each other in the last bit, which would flip contacts.
"""

import math

import numpy as np

from warehouse_env.kernel import inline

ZERO = np.float32(0.0)
HALF = np.float32(0.5)
ONE = np.float32(1.0)
PI = np.float32(math.pi)
TWO_PI = np.float32(2.0 * math.pi)
HALF_PI = np.float32(0.5 * math.pi)
_QUARTER_PI = np.float32(0.25 * math.pi)
_TWO_OVER_PI = np.float32(2.0 / math.pi)
# pi/2 in two parts, the first with few bits: k * _PIO2_HIGH is exact for small k
_PIO2_HIGH = np.float32(1.5703125)
_PIO2_LOW = np.float32(math.pi / 2 - 1.5703125)
_1, _2 = np.int32(1), np.int32(2)
_TAN_PI_8 = np.float32(math.tan(math.pi / 8))

_S3, _S5, _S7, _S9 = (np.float32(c / math.factorial(n)) for c, n in ((-1, 3), (1, 5), (-1, 7), (1, 9)))
_C2, _C4, _C6, _C8 = (np.float32(c / math.factorial(n)) for c, n in ((-1, 2), (1, 4), (-1, 6), (1, 8)))
_A3, _A5, _A7, _A9, _A11, _A13 = (np.float32(c / n) for c, n in ((-1, 3), (1, 5), (-1, 7), (1, 9), (-1, 11), (1, 13)))


@inline
def sin_cos(angle):
    """Return (sin, cos) of an angle [rad], |angle| < 1000."""
    k = np.floor(angle * _TWO_OVER_PI + HALF)
    r = (angle - k * _PIO2_HIGH) - k * _PIO2_LOW
    q = r * r
    s = r + r * q * (_S3 + q * (_S5 + q * (_S7 + q * _S9)))
    c = ONE + q * (_C2 + q * (_C4 + q * (_C6 + q * _C8)))
    quadrant = np.int32(k)
    odd = (quadrant & _1) != 0
    sine = c if odd else s
    cosine = s if odd else c
    # signs by multiplication: questions about one number become a jump table, which stops vector instructions
    return sine * np.float32(_1 - (quadrant & _2)), cosine * np.float32(_1 - ((quadrant + _1) & _2))


@inline
def arc_tan(x):
    """Return atan(x) [rad]."""
    a = abs(x)
    base = ZERO
    sign = ONE
    if a > ONE:
        a = ONE / a
        base = HALF_PI
        sign = -ONE
    shift = ZERO
    if a > _TAN_PI_8:
        a = (a - ONE) / (a + ONE)
        shift = _QUARTER_PI
    q = a * a
    t = shift + (a + a * q * (_A3 + q * (_A5 + q * (_A7 + q * (_A9 + q * (_A11 + q * _A13))))))
    t = base + sign * t
    return t if x >= ZERO else -t


@inline
def arc_tan2(y, x):
    """Return the angle of (x, y) in [-pi, pi] [rad]; 0 for the origin."""
    if x > ZERO:
        return arc_tan(y / x)
    if x < ZERO:
        return arc_tan(y / x) + PI if y >= ZERO else arc_tan(y / x) - PI
    if y > ZERO:
        return HALF_PI
    if y < ZERO:
        return -HALF_PI
    return ZERO


@inline
def wrap(angle):
    """Return an angle of (-3 pi, 3 pi) in [-pi, pi] [rad]."""
    if angle > PI:
        return angle - TWO_PI
    if angle < -PI:
        return angle + TWO_PI
    return angle
