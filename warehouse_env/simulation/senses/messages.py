"""Message loss: in an env step nobody hears a silent robot.

In each physics step a robot announces the motion to which it commits: one step as commanded, then a full stop. It
drives that motion once all robots near it have acknowledged it; otherwise it brakes along the last announced stop. So
losses cost time, never a contact. A silent robot

- brakes within its stop, under the shield (traffic/shield.py);
- appears only in lidar, not among neighbours or predictions;
- gets a grant by right of way that the others do not know: they use the one of the decision before.

Losses are drawn before each env step from a stream of each world, so that the same seed has the same tasks.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig

_STREAM = 1  # behind the world's own entropy


class Messages:
    """Draw the silent robots: a mean share `loss` of them, each for `burst` [s] at a time."""

    def __init__(self, config: EnvConfig, worlds: int) -> None:
        spec = config.uncertainty_spec
        loss = spec.loss
        self._lasts = max(1, round(spec.burst / (config.time_step * config.action_repeat)))  # env steps
        self._late = max(spec.latency - spec.bounds.latency, 0.0) / spec.latency if spec.latency else 0.0
        self._begins = loss / (loss + self._lasts * (1.0 - loss))  # chance in an env step to fall silent
        self._left = np.zeros((worlds, config.num_agents), np.int64)  # env steps for which each stays silent
        # made when first used, as the Dispatcher's
        self._rngs: defaultdict[int, np.random.Generator] = defaultdict(np.random.default_rng)

    def begin(self, world: int, entropy: list[int] | None) -> None:
        """Begin a world's episode; entropy: seeds its generator; None: it continues."""
        self._left[world] = 0
        if entropy is not None:
            self._rngs[world] = np.random.default_rng(np.random.SeedSequence([*entropy, _STREAM]))

    def lose(self, robots: NDArray[Any]) -> None:
        """Write which of robots ROBOT[B, N] are silent in the next env step."""
        if self._begins == self._late == 0:
            return
        self._left = np.maximum(self._left - 1, 0)
        for world in range(len(robots)):
            chances = self._rngs[world].random((2 if self._late else 1, robots.shape[1]))
            self._left[world, (chances[0] < self._begins) & (self._left[world] == 0)] = self._lasts
            robots["shield"]["silent"][world] = (self._left[world] > 0) | (chances[-1] < self._late)
