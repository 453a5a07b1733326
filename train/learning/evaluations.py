"""Evaluations in the course of a training: when one is due, so that they take little of its time."""

from __future__ import annotations

import time
from collections.abc import Callable

from train.learning.config import TrainingConfig
from train.learning.progress import ProgressLog

SHARE = 0.02  # of the time, at most, once it is known how long one takes

Drive = Callable[[TrainingConfig], dict[str, float]]
"""Drives the policy in the folder of a training; returns FIGURES of board.py."""


class Evaluations:
    """Drives the policy of a training now and then, and notes how it went. What is learned does not depend on it."""

    def __init__(self, config: TrainingConfig, drive: Drive, update: int | None) -> None:
        """Begin to wait for the next one; update: after which the policy was driven last, if it was."""
        self._config, self._drive, self._update = config, drive, update
        self._ended, self._took = time.monotonic(), 0.0
        self._first = True

    @property
    def due(self) -> bool:
        """Whether it is time for the next one."""
        every = self._config.evaluation_seconds
        return every > 0.0 and time.monotonic() - self._ended >= max(every, self._took / SHARE)

    def run(self, update: int, steps: int, log: ProgressLog) -> None:
        """Drive the policy that was saved after an update and so many agent-steps, unless it was driven before."""
        if self._config.evaluation_seconds == 0.0 or update == self._update:
            return
        begun = time.monotonic()
        figures = self._drive(self._config)
        self._ended, self._update = time.monotonic(), update
        log.evaluated(figures, steps, self._ended - begun)
        if not self._first:  # which loads and plans besides
            self._took = self._ended - begun
        self._first = False
