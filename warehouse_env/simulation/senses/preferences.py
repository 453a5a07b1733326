"""Preferences of a robot: its lateral offsets, best first, each with its preferred speed.

A policy gives one action, or a number for every action, such as logits. Right of way tries the offsets in this order.
"""

from typing import Any

import numpy as np

from warehouse_env.kernel import inline, kernel
from warehouse_env.simulation.physics.trigonometry import ZERO

# columns of choices: offset [m], its preferred speed, and its preferred speed above 0 [m/s]
SIDE, SPEED, GOING = range(3)


def obey(commands: Any, sides: Any, choices: Any) -> None:
    """Write choices float32[B, N, 1 + O, 3]: the command, then its speed with each of `sides` float32[O].

    Takes arrays or tensors.
    """
    choices[:, :, 0, SIDE] = commands[:, :, 1]
    choices[:, :, 1:, SIDE] = sides
    choices[:, :, :, SPEED] = choices[:, :, :, GOING] = commands[:, :, :1]


@inline
def _best(table, liked, side, least):
    """Return the preferred action with an offset and a speed above `least` [m/s], the first of equals; -1: none."""
    best = -1
    for k in range(table.shape[0]):
        if table[k, 1] == side and table[k, 0] > least and (best < 0 or liked[k] > liked[best]):
            best = k
    return best


@inline
def _sort(table, sides, liked, order):
    """Write order int[O]: the preferred action of each offset, best first."""
    for n in range(sides.size):
        best, k = _best(table, liked, sides[n], -np.inf), n
        while k > 0 and liked[order[k - 1]] < liked[best]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = best


@kernel
def rank(table, sides, preferences, commands, choices, order):
    """Write choices float32[B, N, 1 + O, 3], and the first as commands float32[B, N, 2], by preferences [B, N, A].

    table float32[A, 2]: (speed, offset) of each action; sides float32[O]: the offsets, in the order of equals; order
    int64[O]: scratch. No preference may be nan.
    """
    for b in range(preferences.shape[0]):
        for i in range(preferences.shape[1]):
            liked = preferences[b, i]
            _sort(table, sides, liked, order)
            commands[b, i, 0], commands[b, i, 1] = table[order[0], 0], table[order[0], 1]
            for n in range(choices.shape[2]):
                best = order[max(n - 1, 0)]
                going = _best(table, liked, table[best, 1], ZERO)
                choices[b, i, n, SIDE], choices[b, i, n, SPEED] = table[best, 1], table[best, 0]
                choices[b, i, n, GOING] = table[going if going >= 0 else best, 0]


@inline
def speed_of(r, choices, speed, urged):
    """Return the preferred speed [m/s] at the granted offset, else `speed`; above 0 if urged."""
    for n in range(choices.shape[0]):
        if choices[n, SIDE] == r["traffic"]["side"]:
            speed = choices[n, SPEED]
            if speed <= ZERO and urged:
                speed = choices[n, GOING]
            break
    return speed
