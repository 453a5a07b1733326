"""Races: find the best of several in rounds, dropping those that are significantly worse."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from train.reporting.rows import mean_interval

FEWEST = 3  # rounds before any is dropped

Arm = TypeVar("Arm")
Play = Callable[[Sequence[Arm], int], Sequence[float]]
"""From the remaining arms and the number of the round to their values in it."""


class Raced(NamedTuple, Generic[Arm]):
    """How a race went."""

    values: Mapping[Arm, Sequence[float]]  # one for each of its rounds
    left: Sequence[Arm]  # not told apart from the best

    @property
    def best(self) -> Arm:
        """The remaining arm with the highest mean, the first of equals."""
        return max(self.left, key=lambda arm: mean(self.values[arm]))


def race(
    arms: Sequence[Arm], play: Play[Arm], rounds: int, go_on: Callable[[Sequence[Arm], int], bool],
    settled: Callable[[Sequence[Arm]], bool] = lambda left: len(left) <= 1,
) -> Raced[Arm]:  # fmt: skip
    """Play up to `rounds`, until it is settled or there is no time.

    An arm is dropped if the 95% interval of its difference from the best in the same rounds lies below 0. Each round
    tests again, so this is a rule of thumb: measure the winner in rounds of its own.
    """
    values: dict[Arm, list[float]] = {arm: [] for arm in arms}
    left = list(arms)
    for done in range(rounds):
        if settled(left) or not go_on(left, done):
            break
        for arm, value in zip(left, play(left, done), strict=True):
            values[arm].append(value)
        if done + 1 >= FEWEST:
            best = max(left, key=lambda arm: mean(values[arm]))
            left = [arm for arm in left if not _worse(values[arm], values[best])]
    return Raced(values, left)


def mean(values: Sequence[float]) -> float:
    """Return the mean, 0 of none."""
    return float(np.mean(values)) if values else 0.0


def _worse(values: Sequence[float], best: Sequence[float]) -> bool:
    return mean_interval(np.subtract(values, best).tolist()).high < 0
