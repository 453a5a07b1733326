"""What every policy is: from observations to actions, without memory of its own."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Observation = NDArray[np.float32]
Action = NDArray[Any]


class Policy(Protocol):
    """A decision rule shared by all robots: each row of the observation is decided on alone."""

    name: str

    def act(self, observation: Observation, rng: np.random.Generator) -> Action:
        """Choose the next action command of every robot.

        Args:
            observation: float32[B, N, D], laid out as `observation_layout` of the env config it was made for.
            rng: the only source of chance; the same generator state gives the same actions.

        Returns:
            int64[B, N] for discrete actions, float32[B, N, 2] in [-1, 1] otherwise.
        """
        ...
