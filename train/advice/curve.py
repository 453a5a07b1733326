"""Throughput over the number of robots: the peak, the jam, the knee, and the fewest robots that reach a target.

Pure functions from rows or means to numbers of robots.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import count, takewhile
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice.trials import GOALS, Aim
from train.reporting.columns import MEASURES
from train.reporting.rows import Interval, Row, t_quantile

STUCK = 0.05  # share of robots stuck at the end, at which a floor is jammed
NEAR = 0.97  # of the best throughput, which a smaller number must reach to be named instead
HALF = 0.5  # of the first robot's throughput, which a further one should add
DRAWS = 2_000  # of all means, for the interval of the knee


class LoadPoint(NamedTuple):
    """Throughput of a number of robots."""

    robots: int
    episodes: int
    goals: Interval  # or orders per hour, all robots together, in the second half of the episodes
    each: Interval  # per robot and hour, the same
    stuck: Interval  # share at the end
    waiting: Interval  # share of time
    jammed: bool


def loads(rows: Mapping[int, Sequence[Row]], aim: Aim = GOALS) -> list[LoadPoint]:
    """Return the load of each number of robots, fewest first.

    A floor is jammed if STUCK of the robots are stuck, or all reach less than `aim.fell` of what fewer robots reach.
    """
    found: list[LoadPoint] = []
    for robots in sorted(rows):
        own = rows[robots]
        each, stuck, waiting = (one.interval(own) for one in (aim.late, MEASURES["stuck"], MEASURES["waiting_share"]))
        goals = each.times(robots)
        best = max((load.goals.mean for load in found), default=0.0)
        jammed = stuck.mean >= STUCK or goals.mean < aim.fell * best
        found.append(LoadPoint(robots, len(own), goals, each, stuck, waiting, jammed))
    return found


def peak(found: Sequence[LoadPoint]) -> LoadPoint:
    """Return the load with the highest throughput, the smallest of equals; a jammed one only if all are."""
    return max(found, key=lambda load: (not load.jammed, load.goals.mean, -load.robots))


def jams_from(found: Sequence[LoadPoint]) -> LoadPoint | None:
    """Return the smallest load from which on all loads are jammed, None if the largest is not."""
    jammed = list(takewhile(lambda load: load.jammed, reversed(found)))
    return jammed[-1] if jammed else None


def rungs(low: int, high: int) -> list[int]:
    """Return the numbers 1, 2, 3, 4, 6, 8, 12, 16, ... from `low` to `high`, and `high` itself."""
    both = (number for power in count() for number in (2**power, 3 * 2 ** (power - 1)) if power or number == 1)
    return sorted({number for number in takewhile(lambda one: one <= 2 * high, both) if low <= number <= high} | {high})


def smallest(means: Mapping[int, float]) -> int:
    """Return the smallest number of robots whose mean comes NEAR to the best."""
    return min(robots for robots, mean in means.items() if mean >= NEAR * max(means.values()))


def knee(found: Sequence[LoadPoint], alone: Interval, seed: int) -> Interval | None:
    """Return the number of robots from which a further one adds less than HALF of one alone, None if there is none.

    The gain of a further robot is assumed to fall monotonically, and is interpolated between the middles of loads. The
    interval comes from DRAWS of all means by Student's t; it is open above if one draw in forty has no knee.
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
    """Return float64[DRAWS]: draws of a mean by its interval."""
    freedom = mean.samples - 1
    return mean.mean + (mean.high - mean.mean) / t_quantile(freedom) * rng.standard_t(freedom, DRAWS)


def _crossing(means: NDArray[np.float64], widths: NDArray[np.float64], middles: NDArray[np.float64]) -> float:
    """Return where slopes fall to HALF of means[0], else infinity; means[1:] are at the ends of the widths."""
    from scipy.optimize import isotonic_regression  # not when this is loaded, which takes long

    slopes = isotonic_regression(np.diff([0.0, *means[1:]]) / widths, weights=widths, increasing=False).x
    slopes, middles = np.concatenate([[max(means[0], slopes[0])], slopes]), np.concatenate([[0.0], middles])
    below = np.flatnonzero(slopes < HALF * means[0])
    if not len(below):
        return math.inf
    k = int(below[0])
    share = (slopes[k - 1] - HALF * means[0]) / (slopes[k - 1] - slopes[k])
    return float(middles[k - 1] + share * (middles[k] - middles[k - 1]))


def fewest_that(reaches: Callable[[int], bool], low: int, high: int) -> int:
    """Return the fewest robots that reach a target, by bisection to a sixteenth: `low` do not, `high` do."""
    while high - low > max(1, high // 16):
        middle = (low + high) // 2
        low, high = (low, middle) if reaches(middle) else (middle, high)
    return high


def bracket(found: Sequence[LoadPoint], wanted: float) -> tuple[int, int] | None:
    """Return the numbers between which the fewest robots that reach `wanted` lie; None if no mean reaches it.

    The mean of the first lies below (0: no robots), the interval of the second above, or it is the best number.
    """
    rising = [load for load in found if load.robots <= peak(found).robots]
    enough = [load.robots for load in rising if load.goals.mean >= wanted]
    if not enough:
        return None
    below = max((load.robots for load in rising if load.robots < enough[0]), default=0)
    return below, next((load.robots for load in rising if load.goals.low >= wanted), rising[-1].robots)
