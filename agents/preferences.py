"""Policies that say how much they like each action, for what then chooses among them: Simulator.step, right of way."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from agents.policy import Observation, Policy
from agents.sampling import gumbel


@runtime_checkable
class Preferring(Policy, Protocol):
    """A policy of discrete actions that has preferences. One without them has its action, then any side at its speed.

    Attributes:
        drawn: whether the preferences are logits to draw from, rather than an order.
    """

    drawn: bool

    def preferences(self, observation: Observation) -> NDArray[np.float32]:
        """Return how much each action is liked, float32[B, N, A] from float32[B, N, D]."""
        ...


def ranked(policy: Preferring, observation: Observation, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return preferences float32[B, N, A] whose order is the policy's: a draw with `rng`, if it draws.

    The order of logits + Gumbel noise is that of drawing one action after another without putting back
    (Plackett-Luce), and the first is drawn as `act` does.
    """
    liked = policy.preferences(observation)
    return liked + gumbel(liked.shape, rng) if policy.drawn else liked
