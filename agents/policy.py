"""The protocol of policies, from observations to actions, and the drawing of actions."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Observation = NDArray[np.float32]
Action = NDArray[Any]


class Policy(Protocol):
    """A decision rule shared by all robots: each row of the observation is decided on alone."""

    name: str

    def act(self, observation: Observation, rng: np.random.Generator) -> Action:
        """Return the next action command of every robot: int64[B, N] if discrete, else float32[B, N, 2] in [-1, 1].

        `observation` is float32[B, N, D], laid out as `observation_layout` of the env config it was made for; `rng` is
        the only source of chance: the same generator state gives the same actions.
        """
        ...


@runtime_checkable
class Preferring(Policy, Protocol):
    """A policy with a preference for each discrete action, so that right of way can choose among them.

    One without preferences has its action, then any side at its speed. drawn: whether the preferences are logits to
    draw from, rather than an order.
    """

    drawn: bool

    def preferences(self, observation: Observation) -> NDArray[np.float32]:
        """Return the preference for each action, float32[B, N, A] from float32[B, N, D]."""
        ...


def ranked(policy: Preferring, observation: Observation, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return preferences float32[B, N, A] whose order is the policy's: a draw with `rng`, if it draws.

    The order of logits + Gumbel noise is that of drawing one action after another without putting back
    (Plackett-Luce), and the first is drawn as `act` does.
    """
    liked = policy.preferences(observation)
    return liked + gumbel(liked.shape, rng) if policy.drawn else liked


def draw_discrete(logits: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw one action a row by softmax(logits), by the Gumbel trick: int64[M] from float32[M, A]."""
    return np.asarray(np.argmax(logits + gumbel(logits.shape, rng), axis=-1))


def gumbel(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw from the standard Gumbel distribution: -log(E), where E is a standard exponential."""
    exponential = rng.standard_exponential(shape, dtype=np.float32)
    exponential += np.float32(1e-30)  # an exact 0 would win against any logit
    return np.asarray(-np.log(exponential))
