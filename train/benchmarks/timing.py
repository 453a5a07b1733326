"""Calls timed in turns, so that a machine whose speed varies treats them alike."""

import statistics
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

from train.reporting.rows import Row

CHUNKS = 9  # a speed is the median over these
Clock = Callable[[], float]  # [s]
Call = tuple[Callable[[int], object], int]  # does step k of so many robots


class Timed(NamedTuple):
    """A function that steps `rows` robots, called `steps` times in a chunk."""

    call: Callable[[int], object]  # does step k
    rows: int
    steps: int

    def warmed(self, steps: int) -> Self:
        """Return this after some steps; the timed steps continue where these end."""
        for k in range(steps):
            self.call(k)
        return self._replace(call=lambda k, call=self.call: call(k + steps))  # type: ignore[misc]


def in_turns(timed: Sequence[Timed], chunks: int, clock: Clock) -> list[list[float]]:
    """Return for each its time [us] of a robot's step in each chunk, measured in turns."""
    spent: list[list[float]] = [[] for _ in timed]
    for chunk in range(chunks):
        for one, times in zip(timed, spent, strict=True):
            begin = clock()
            for k in range(chunk * one.steps, (chunk + 1) * one.steps):
                one.call(k)
            times.append(1e6 * (clock() - begin) / (one.steps * one.rows))
    return spent


def speeds(calls: Sequence[Call], seconds: float, clock: Clock = time.perf_counter) -> list[Row]:
    """Return the agent-steps/s of calls, measured in turns: the median, lowest and highest chunk of each.

    seconds: of each, after its warm-up.
    """
    timed = [Timed(call, rows, _count(call, seconds / CHUNKS, clock)) for call, rows in calls]
    rates = [[1e6 / each for each in spent] for spent in in_turns(timed, CHUNKS, clock)]
    return [{"agent_steps_per_s": statistics.median(each), "low": min(each), "high": max(each)} for each in rates]


def _count(call: Callable[[int], object], seconds: float, clock: Clock) -> int:
    """Return how many calls fill so many seconds once the first has compiled."""
    call(0)
    begin, count = clock(), 0
    while clock() - begin < seconds:
        count += 1
        call(count)
    return max(1, count)
