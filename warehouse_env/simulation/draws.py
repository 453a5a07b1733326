"""Random numbers by counter: Philox4x32-10 (Salmon, Moraes, Dror and Shaw 2011, "Parallel random numbers").

A number depends only on its key and its counter, so it is the same bits in any order, on any thread and device. The key
comes from the seed and the world. The counter names the purpose, the world's episode since the seed, the robot, what is
drawn for it (such as its goal's number), and the attempt.
"""

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, kernel

Key = NDArray[np.uint64]
"""[3], a row of `Draws.keys`."""

# Purposes: numbers drawn for one do not depend on those drawn for another.
START, ELSEWHERE, KIND, GOAL, TRIAL, DRIFT, ERROR, LOSS = range(8)
_PURPOSES = 8

_HALF, _LOW = np.uint64(32), np.uint64(0xFFFFFFFF)
_FIRST_FACTOR, _SECOND_FACTOR = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_FIRST_STEP, _SECOND_STEP = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_ROUNDS = 10


@inline
def philox(a, b, c, d, key, other):
    """Return four random words from a counter of four words and a key of two; all uint64 below 2**32."""
    for _ in range(_ROUNDS):
        first, second = _FIRST_FACTOR * a, _SECOND_FACTOR * c
        a, b, c, d = (second >> _HALF) ^ b ^ key, second & _LOW, (first >> _HALF) ^ d ^ other, first & _LOW
        key, other = (key + _FIRST_STEP) & _LOW, (other + _SECOND_STEP) & _LOW
    return a, b, c, d


@inline
def words(key, purpose, robot, number, attempt):
    """Return four random words, uint64 below 2**32; key: see Key; the rest: see above."""
    place = key[2] * np.uint64(_PURPOSES) + np.uint64(purpose)
    return philox(np.uint64(attempt), np.uint64(number), np.uint64(robot), place & _LOW, key[0], key[1])


@inline
def fraction(word):
    """Return a word as a float64 from 0 to below 1."""
    return np.float64(word) * 2.0**-32


@kernel
def below(key, purpose, robot, number, attempt, count):
    """Return a whole number from 0 to below `count`, which is below 2**32; see `words`."""
    word, _, _, _ = words(key, purpose, robot, number, attempt)
    return np.int64(word * np.uint64(count) >> _HALF)


@kernel
def shuffle(key, purpose, order):
    """Write the numbers below the length of `order`, a whole-number array, into it in a random order; see `words`."""
    for k in range(len(order)):
        order[k] = k
    for k in range(len(order) - 1, 0, -1):
        other = below(key, purpose, 0, k, 0, k + 1)
        order[k], order[other] = order[other], order[k]


class Draws:
    """The keys of all worlds, uint64[B, 3]: two words from the seed and the world, and the episode since then."""

    def __init__(self, worlds: int) -> None:
        self.keys = np.zeros((worlds, 3), dtype=np.uint64)
        self.begun = np.zeros(worlds, dtype=np.bool_)

    def begin(self, world: int, entropy: list[int] | None) -> None:
        """Begin a world's episode: the first of a seed, or without one the next; the very first is then by chance."""
        if entropy is None and self.begun[world]:
            self.keys[world, 2] += np.uint64(1)
            return
        self.keys[world, :2] = np.random.SeedSequence(entropy).generate_state(2)
        self.keys[world, 2], self.begun[world] = 0, True
