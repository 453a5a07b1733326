"""Evaluations during a training, spaced so that they take little of its time."""

from __future__ import annotations

import time
from collections.abc import Callable

from train.learning.config import TrainingConfig
from train.learning.progress import ProgressLog

SHARE = 0.03  # of the processor time, at most, from one to the next

Drive = Callable[[TrainingConfig], dict[str, float]]
"""Drives the policy in the folder of a training; returns FIGURES of progress.py."""


class Evaluations:
    """Drives the policy of a training from time to time and logs the result, without changing what is learned."""

    def __init__(self, config: TrainingConfig, drive: Drive, update: int | None) -> None:
        """Start the clock; update: after which the policy was driven last, if any."""
        self._config, self._drive, self._update = config, drive, update
        self._ended, self._took = (time.monotonic(), time.process_time()), 0.0

    @property
    def due(self) -> bool:
        """Whether the next evaluation is due."""
        every, (since, worked_since) = self._config.evaluation_seconds, self._ended
        worked = time.process_time() - worked_since  # of all threads; where others take the cores, it grows slowly
        return every > 0.0 and time.monotonic() - since >= every and worked * SHARE >= self._took

    def run(self, update: int, steps: int, log: ProgressLog) -> None:
        """Drive the policy that was saved after an update and `steps` agent-steps, unless this was done already."""
        if self._config.evaluation_seconds == 0.0 or update == self._update:
            return
        begun, worked = time.monotonic(), time.process_time()
        figures = self._drive(self._config)
        self._ended, self._update = (time.monotonic(), time.process_time()), update
        self._took = self._ended[1] - worked
        log.evaluated(figures, steps, self._ended[0] - begun)
