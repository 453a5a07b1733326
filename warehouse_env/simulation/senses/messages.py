"""Message loss: in an env step nobody hears a silent robot.

In each physics step a robot announces the motion to which it commits: one step as commanded, then a full stop. It
drives that motion once all robots near it have acknowledged it; otherwise it brakes along the last announced stop. So
losses cost time, never a contact. A silent robot

- brakes within its stop, under the shield (traffic/shield.py);
- appears only in lidar, not among neighbours or predictions;
- gets a grant by right of way that the others do not know: they use the one of the decision before.

Losses are drawn before each env step for a purpose of their own (draws.py), so that the same seed has the same tasks.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import kernel
from warehouse_env.simulation.draws import LOSS, Draws, fraction, words


class Messages:
    """Draw the silent robots: a mean share `loss` of them, each for `burst` [s] at a time."""

    def __init__(self, config: EnvConfig, worlds: int, draws: Draws) -> None:
        spec = config.uncertainty_spec
        loss = spec.loss
        self._lasts = max(1, round(spec.burst / (config.time_step * config.action_repeat)))  # env steps
        self._late = max(spec.latency - spec.bounds.latency, 0.0) / spec.latency if spec.latency else 0.0
        self._begins = loss / (loss + self._lasts * (1.0 - loss))  # chance in an env step to fall silent
        self._left = np.zeros((worlds, config.num_agents), np.int64)  # env steps for which each stays silent
        self._keys = draws.keys
        self._steps = np.zeros(worlds, np.int64)  # env steps of each world's episode

    def begin(self, world: int) -> None:
        """Begin a world's episode."""
        self._left[world] = self._steps[world] = 0

    def lose(self, robots: NDArray[Any]) -> None:
        """Write which of robots ROBOT[B, N] are silent in the next env step."""
        if self._begins == self._late == 0:
            return
        _lose(self._keys, self._steps, self._begins, self._late, self._lasts, self._left, robots)
        self._steps += 1


@kernel
def _lose(keys, steps, begins, late, lasts, left, robots):
    """Count down how long robots ROBOT[B, N] are silent, left int64[B, N], and write who is; steps: int64[B]."""
    for b, i in np.ndindex(left.shape):
        first, second, _, _ = words(keys[b], LOSS, i, steps[b], 0)
        left[b, i] = max(left[b, i] - 1, 0)
        if left[b, i] == 0 and fraction(first) < begins:
            left[b, i] = lasts
        robots[b, i]["shield"]["silent"] = left[b, i] > 0 or fraction(second) < late
