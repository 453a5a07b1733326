"""Draws by counter: the published numbers, each purpose and world apart, even, and each episode of a seed another."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from warehouse_env.kernel import kernel
from warehouse_env.simulation import draws
from warehouse_env.simulation.draws import Draws, below, philox, shuffle

KEY = np.array([0xA4093822, 0x299F31D0, 0], dtype=np.uint64)


@kernel
def answer(counter, key):  # type: ignore[no-untyped-def]
    return philox(counter[0], counter[1], counter[2], counter[3], key[0], key[1])


# Random123's kat_vectors for philox4x32 with 10 rounds: counter, key, answer
PUBLISHED = (
    ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
)


@pytest.mark.parametrize("published", PUBLISHED)
def test_the_words_are_the_published_ones(published: tuple[str, str, str]) -> None:
    counter, key, wanted = (np.array([int(word, 16) for word in line.split()], np.uint64) for line in published)
    assert answer(counter, key) == tuple(wanted.tolist())


def test_numbers_are_even_and_below_their_bound() -> None:
    drawn = [below(KEY, draws.GOAL, robot, number, 0, 7) for robot in range(100) for number in range(70)]
    counts = np.bincount(drawn, minlength=7)
    assert len(counts) == 7
    assert np.abs(counts - 1000).max() < 110  # 3.8 standard deviations


def test_each_part_of_a_counter_and_of_a_key_matters() -> None:
    ways = itertools.product(range(2), range(8), range(3), range(3), range(3))
    seen = {below(KEY + np.array([0, 0, e], np.uint64), *rest, 2**32 - 1) for e, *rest in ways}
    assert len(seen) == 2 * 8 * 27
    other = KEY + np.array([1, 0, 0], np.uint64)
    assert below(other, 0, 0, 0, 0, 2**32 - 1) not in seen


def test_a_permutation_has_each_number_once_and_all_places_alike() -> None:
    first = np.empty((2000, 5), np.int32)
    for e, order in enumerate(first):
        shuffle(KEY + np.array([0, 0, e], np.uint64), draws.START, order)
    assert all(sorted(order) == [0, 1, 2, 3, 4] for order in first.tolist())
    assert np.abs(np.mean(first, axis=0) - 2.0).max() < 0.13  # 4 standard deviations


def test_a_seed_gives_its_episodes_again_and_an_unseeded_world_its_own() -> None:
    one, other, free = Draws(2), Draws(1), [Draws(1) for _ in range(2)]
    episodes = []
    for entropy in ([5, 0], None, None, [5, 0]):
        one.begin(0, entropy)
        episodes.append(one.keys[0].tolist())
    assert episodes[0] == episodes[3]
    assert len(set(map(tuple, episodes))) == 3
    other.begin(0, [5, 1])
    assert other.keys[0].tolist() != episodes[0]
    for draw in free:
        draw.begin(0, None)
    assert free[0].keys.tolist() != free[1].keys.tolist()
