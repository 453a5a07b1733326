"""Message loss: in an env step nobody hears a silent robot.

In each physics step a robot announces the motion to which it commits: one step as commanded, then a full stop. It
drives that motion once all robots near it have acknowledged it; otherwise it brakes along the last announced stop. So
losses cost time, never a contact. A silent robot

- brakes within its stop, under the shield (traffic/shield.py);
- appears only in lidar, not among neighbours or predictions;
- gets a grant by right of way that the others do not know: they use the one of the decision before.

Losses are drawn before each env step for a purpose of their own (draws.py), so that the same seed has the same tasks.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import kernel
from warehouse_env.simulation.draws import LOSS, fraction, words


class Losses(NamedTuple):
    """How robots fall silent, and for how long."""

    begins: float  # chance in an env step to fall silent
    late: float  # chance that a message comes too late
    lasts: int  # env steps
    left: NDArray[np.int64]  # [B, N], env steps for which each stays silent

    @property
    def occur(self) -> bool:
        """Whether any message can be lost."""
        return self.begins > 0.0 or self.late > 0.0


def losses_of(config: EnvConfig, worlds: int) -> Losses:
    """Return losses by which a mean share `loss` of the robots is silent, each for `burst` [s] at a time."""
    spec = config.uncertainty_spec
    lasts = max(1, round(spec.burst / (config.time_step * config.action_repeat)))  # env steps
    late = max(spec.latency - spec.bounds.latency, 0.0) / spec.latency if spec.latency else 0.0
    begins = spec.loss / (spec.loss + lasts * (1.0 - spec.loss))
    return Losses(begins, late, lasts, np.zeros((worlds, config.num_agents), np.int64))


@kernel
def draw_silent(begin, end, keys, steps, losses, robots):
    """Count down the silence of robots ROBOT[B, N] of the worlds from `begin` to before `end`, and mark silent ones.

    keys: of the Draws; steps int64[B]: since the resets; losses: Losses.
    """
    left = losses.left
    for b in range(begin, end):
        for i in range(left.shape[1]):
            first, second, _, _ = words(keys[b], LOSS, i, steps[b], 0)
            left[b, i] = max(left[b, i] - 1, 0)
            if left[b, i] == 0 and fraction(first) < losses.begins:
                left[b, i] = losses.lasts
            robots[b, i]["shield"]["silent"] = left[b, i] > 0 or fraction(second) < losses.late
