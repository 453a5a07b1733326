"""Where the time of a training goes, and how many threads it may use."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import torch

from warehouse_env.threads import MOST_THREADS, set_num_threads

PARTS = ("simulator_s", "policy_s", "update_s")


class Split:
    """Seconds spent in each part: "simulator_s", "policy_s" (forward passes of the rollouts) and "update_s"."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(PARTS, 0.0)

    @contextmanager
    def measure(self, part: str) -> Iterator[None]:
        """Add the time of the block to `part`."""
        begun = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[part] += time.perf_counter() - begun

    def with_mean_of(self, others: Sequence[Split]) -> Split:
        """Return these seconds plus the mean of others that ran side by side."""
        joined = Split()
        for part in PARTS:
            joined.seconds[part] = self.seconds[part] + sum(one.seconds[part] for one in others) / len(others)
        return joined


def set_threads(threads: int) -> None:
    """Use this many threads in torch and in the simulator, as far as the machine allows, from the calling thread."""
    torch.set_num_threads(threads)
    set_num_threads(min(threads, MOST_THREADS))
