"""What a floor does with more and more robots: where it jams, where one more is hardly worth it, how many make enough.

Nothing here drives: rows or means in, numbers of robots out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import count, takewhile
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice.aim import GOALS, Aim
from train.reporting.columns import MEASURES
from train.reporting.rows import Interval, Row, t_quantile

STUCK = 0.05  # share of robots stuck at the end from which a floor counts as jammed
NEAR = 0.97  # of the most goals: with less, a smaller number is not named in place of the best, though none can be told
HALF = 0.5  # of what the first robot brings: what a further one should
DRAWS = 2_000  # of the means, for the interval of the knee


class Load(NamedTuple):
    """What a floor does with a number of robots."""

    robots: int
    episodes: int
    goals: Interval  # or orders per hour, all robots together, in the second half of the episodes
    each: Interval  # per robot and hour, the same
    stuck: Interval  # share at the end
    waiting: Interval  # share of time
    jammed: bool
    share: Interval | None = None  # of what is made, where that is asked for

    @property
    def asked(self) -> Interval:
        """What is held against the wish."""
        return self.goals if self.share is None else self.share


def loads(rows: Mapping[int, Sequence[Row]], aim: Aim = GOALS) -> list[Load]:
    """Return what was measured for each number of robots, fewest first.

    A floor is jammed with so many robots where STUCK of them are stuck, or all together reach less than `aim.fell` of
    the most that fewer robots reached.
    """
    found: list[Load] = []
    for robots in sorted(rows):
        own = rows[robots]
        each, stuck, waiting = (one.interval(own) for one in (aim.late, MEASURES["stuck"], MEASURES["waiting_share"]))
        goals = each.times(robots)
        best = max((load.goals.mean for load in found), default=0.0)
        jammed = stuck.mean >= STUCK or goals.mean < aim.fell * best
        share = None if aim.share is None else aim.share.interval(own)
        found.append(Load(robots, len(own), goals, each, stuck, waiting, jammed, share))
    return found


def peak(found: Sequence[Load]) -> Load:
    """Return the load with the most goals, the smallest of equals; one that jams only where all do."""
    return max(found, key=lambda load: (not load.jammed, load.goals.mean, -load.robots))


def jams_from(found: Sequence[Load]) -> Load | None:
    """Return the smallest load from which on all that were tried jam; None where the largest does not."""
    jammed = list(takewhile(lambda load: load.jammed, reversed(found)))
    return jammed[-1] if jammed else None


def rungs(low: int, high: int) -> list[int]:
    """Return the numbers 1, 2, 3, 4, 6, 8, 12, 16, ... from `low` to `high`, and `high` itself."""
    both = (number for power in count() for number in (2**power, 3 * 2 ** (power - 1)) if power or number == 1)
    return sorted({number for number in takewhile(lambda one: one <= 2 * high, both) if low <= number <= high} | {high})


def smallest(means: Mapping[int, float], left: Sequence[int]) -> int:
    """Return the smallest of the numbers `left`, which were not told apart from the best, that comes NEAR to it."""
    best = max(means[robots] for robots in left)
    return min(robots for robots in left if means[robots] >= NEAR * best)


def knee(found: Sequence[Load], alone: Interval, seed: int) -> Interval | None:
    """Return the number of robots from which a further one brings less than HALF of what one alone does.

    What a further robot brings is taken to fall all the way, and between two loads to be what the middle between them
    has. The interval is that of DRAWS of all means by Student's t; infinite above where one draw in forty has no knee.
    None where the loads do not reach it.
    """
    known = [load for load in found if load.goals.samples >= 2]
    if not known:
        return None
    means = [alone, *(load.goals for load in known)]
    widths = np.diff([0.0, *(float(load.robots) for load in known)])
    middles = np.cumsum(widths) - widths / 2
    at = _crossing(np.array([one.mean for one in means]), widths, middles)
    if not math.isfinite(at):
        return None
    rng = np.random.default_rng(seed)
    drawn = [_crossing(one, widths, middles) for one in np.stack([_draws(one, rng) for one in means], axis=1)]
    low, high = np.quantile(drawn, (0.025, 0.975), method="higher")
    return Interval(at, float(low), float(high), min(one.samples for one in means))


def _draws(mean: Interval, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return float64[DRAWS]: what a mean may really be, by its interval."""
    freedom = mean.samples - 1
    return mean.mean + (mean.high - mean.mean) / t_quantile(freedom) * rng.standard_t(freedom, DRAWS)


def _crossing(means: NDArray[np.float64], widths: NDArray[np.float64], middles: NDArray[np.float64]) -> float:
    """Return where slopes fall to HALF of means[0], infinite where they do not; means[1:] at the ends of the widths."""
    slopes = falling(np.diff([0.0, *means[1:]]) / widths, widths)
    slopes, middles = np.concatenate([[max(means[0], slopes[0])], slopes]), np.concatenate([[0.0], middles])
    below = np.flatnonzero(slopes < HALF * means[0])
    if not len(below):
        return math.inf
    k = int(below[0])
    share = (slopes[k - 1] - HALF * means[0]) / (slopes[k - 1] - slopes[k])
    return float(middles[k - 1] + share * (middles[k] - middles[k - 1]))


def falling(values: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values that never rise and are nearest to `values` by weighted squares (pool adjacent violators)."""
    pools: list[tuple[float, float, int]] = []  # mean, weight, members
    for value, weight in zip(values.tolist(), weights.tolist(), strict=True):
        pools.append((value, weight, 1))
        while len(pools) > 1 and pools[-2][0] < pools[-1][0]:
            (one, of, n), (other, by, m) = pools[-2:]
            pools[-2:] = [((one * of + other * by) / (of + by), of + by, n + m)]
    return np.repeat([mean for mean, _, _ in pools], [members for _, _, members in pools])


def fewest_that(reaches: Callable[[int], bool], low: int, high: int) -> int:
    """Return the fewest robots that reach something, by halves: `low` do not, `high` do; within a sixteenth of them."""
    while high - low > max(1, high // 16):
        middle = (low + high) // 2
        low, high = (low, middle) if reaches(middle) else (middle, high)
    return high


def bracket(found: Sequence[Load], wanted: float) -> tuple[int, int] | None:
    """Return between which numbers the fewest lie that make `wanted` goals, or such a share; None where no mean does.

    The first has a mean below (0: none), the second is the first with an interval above, or that with the most.
    """
    top = max(found, key=lambda load: (not load.jammed, load.asked.mean, -load.robots))
    rising = [load for load in found if load.robots <= top.robots]
    enough = [load.robots for load in rising if load.asked.mean >= wanted]
    if not enough:
        return None
    below = max((load.robots for load in rising if load.robots < enough[0]), default=0)
    return below, next((load.robots for load in rising if load.asked.low >= wanted), rising[-1].robots)
