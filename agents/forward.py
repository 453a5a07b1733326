"""An actor's forward pass as kernels of our own: float32 from + - * / alone, in one fixed order for each row.

A BLAS is about twice as fast on one thread. But it wakes its own threads, which then spin on the cores that the
simulator's next step needs, and its sums depend on the machine, the threads and the number of rows. Here a row's output
has the same bits on every machine, alone or among others.
"""

from collections.abc import Sequence
from math import comb, perm

import numpy as np
from numpy.typing import NDArray

from agents.weights_folder import Activation
from warehouse_env.kernel import inline, kernel

Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Weights float32[inputs, outputs], and biases float32[outputs]."""

# Pade's exp(2x) = N(2x) / N(-2x) of degree 13 makes tanh x = x P(x^2) / Q(x^2): N's odd terms over its even ones.
_TERMS = tuple(np.float32(2**k * comb(13, k) / perm(26, k)) for k in range(14))
_P, _Q = _TERMS[1::2], _TERMS[::2]
_LIMIT = np.float32(9.0)  # from here on tanh is 1 in float32
_ONE = np.float32(1.0)
_HALF, _TWO = np.float32(0.5), np.float32(2.0)
_LEAK = np.float32(0.01)  # leaky_relu's slope below 0, torch's own
_OTHERS = ("relu", "leaky_relu", "elu", "silu", "sigmoid")  # by their numbers in `_activate`


@inline
def _tanh(x):
    """Return tanh x within 4e-7, and never beyond 1."""
    x = min(max(x, -_LIMIT), _LIMIT)
    s = x * x
    p = _P[0] + s * (_P[1] + s * (_P[2] + s * (_P[3] + s * (_P[4] + s * (_P[5] + s * _P[6])))))
    q = _Q[0] + s * (_Q[1] + s * (_Q[2] + s * (_Q[3] + s * (_Q[4] + s * (_Q[5] + s * _Q[6])))))
    return min(max(x * p / q, -_ONE), _ONE)


@kernel
def _layer(x, weight, bias, squash):
    """Return bias + x @ weight, float32[M, outputs] from float32[M, inputs], through tanh if `squash`.

    Each sum begins with the bias and runs over the inputs in their order, four at a time: fewer sums are rounded, and
    weights and sums are loaded less often. Rows go in pairs for that as well; an odd last row is paired with itself,
    into a row to spare.
    """
    rows, inputs = x.shape
    out = np.empty((rows + rows % 2, bias.size), np.float32)
    for m in range(0, rows, 2):
        n = min(m + 1, rows - 1)
        one, two = out[m], out[m + 1]
        one[:] = bias
        two[:] = bias
        for k in range(inputs % 4):
            for j in range(bias.size):
                one[j] += x[m, k] * weight[k, j]
                two[j] += x[n, k] * weight[k, j]
        for k in range(inputs % 4, inputs, 4):
            a, b, c, d = weight[k], weight[k + 1], weight[k + 2], weight[k + 3]
            p, q, r, s = x[m, k], x[m, k + 1], x[m, k + 2], x[m, k + 3]
            t, u, v, w = x[n, k], x[n, k + 1], x[n, k + 2], x[n, k + 3]
            for j in range(bias.size):
                e, f, g, h = a[j], b[j], c[j], d[j]
                one[j] += (p * e + q * f) + (r * g + s * h)
                two[j] += (t * e + u * f) + (v * g + w * h)
    if squash:
        for m in range(rows):
            for j in range(bias.size):
                out[m, j] = _tanh(out[m, j])
    return out[:rows]


@kernel
def _activate(x, which):
    """Put float32[M, outputs] through an activation other than tanh, in place; what needs e^x has it from tanh."""
    for m in range(x.shape[0]):
        for j in range(x.shape[1]):
            v = x[m, j]
            if which == 0:
                x[m, j] = np.float32(0.0) if v < 0 else v
            elif which == 1:
                x[m, j] = _LEAK * v if v < 0 else v
            elif which == 2:
                t = _tanh(_HALF * v)
                x[m, j] = _TWO * t / (_ONE - t) if v < 0 else v
            else:
                share = _HALF + _HALF * _tanh(_HALF * v)
                x[m, j] = v * share if which == 3 else share


def forward(
    layers: Sequence[Layer], observation: NDArray[np.float32], activation: Activation = "tanh"
) -> NDArray[np.float32]:
    """Return the outputs of a network with an activation between its layers, float32[..., A] from float32[..., D]."""
    x = np.ascontiguousarray(observation, dtype=np.float32).reshape(-1, observation.shape[-1])
    for index, (weight, bias) in enumerate(layers):
        between = index < len(layers) - 1
        x = _layer(x, weight, bias, between and activation == "tanh")
        if between and activation != "tanh":
            _activate(x, _OTHERS.index(activation))
    return x.reshape(*observation.shape[:-1], x.shape[-1])
