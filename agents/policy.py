"""The protocols of policies, from observations to actions, and the drawing of actions."""

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig

Observation = NDArray[np.float32]
Action = NDArray[Any]
Memory = NDArray[Any]


class Policy(Protocol):
    """A decision rule shared by all robots: each row of the observation is decided on alone.

    It keeps nothing from one decision to the next; a policy that does is `Recurrent`.
    """

    def act(self, observation: Observation, rng: np.random.Generator) -> Action:
        """Return the next action command of every robot: int64[B, N] if discrete, else float32[B, N, 2] in [-1, 1].

        `observation` is float32[B, N, D], laid out as `observation_layout` of the env config it was made for; `rng` is
        the only source of chance: the same generator state gives the same actions.
        """


@runtime_checkable
class Recurrent(Protocol):
    """A policy with a memory of each world, which the caller keeps: one object serves any number of worlds."""

    def memory(self, worlds: int) -> Memory:
        """Return the memory of so many worlds at the start of their episodes, an array [worlds, ...]."""

    def act(self, observation: Observation, rng: np.random.Generator, memory: Memory) -> tuple[Action, Memory]:
        """Return actions as `Policy.act` does, and the memory for the next decision, [B, ...] as given."""


@runtime_checkable
class Preferring(Protocol):
    """A policy with a preference for each discrete action, so that right of way can choose among them.

    One without preferences has its action, then any side at its speed. drawn: whether the preferences are logits to
    draw from, rather than an order. A recurrent policy's `preferences` takes and returns the memory, as its `act`.
    """

    drawn: bool

    def preferences(self, observation: Observation) -> NDArray[np.float32]:
        """Return the preference for each action, float32[B, N, A] from float32[B, N, D]."""


class Actor:
    """Drives a batch of worlds by a policy, and keeps their memory, if it has one."""

    def __init__(self, policy: Any, config: EnvConfig, worlds: int = 1) -> None:
        """Begin an episode in each world; policy: a `Policy` or `Recurrent`."""
        self._policy = policy
        by_right = config.traffic_spec.right_of_way and config.action_type == "discrete"
        self._ranks = by_right and isinstance(policy, Preferring)
        self.memory: Any = policy.memory(worlds) if isinstance(policy, Recurrent) else None

    def __call__(self, observation: Observation, rng: np.random.Generator) -> Action:
        """Return what `Simulator.step` takes: preferences if right of way can use them, otherwise actions.

        The order of logits + Gumbel noise is that of drawing one action after another without putting back
        (Plackett-Luce), and the first is drawn as `act` does.
        """
        if not self._ranks:
            return self._remember(self._policy.act, observation, rng)
        liked = self.preferences(observation)
        return liked + gumbel(liked.shape, rng) if self._policy.drawn else liked

    def preferences(self, observation: Observation) -> NDArray[np.float32]:
        """Return the preferences of a `Preferring` policy, as they are."""
        return self._remember(self._policy.preferences, observation)

    def _remember(self, choose: Callable[..., Any], *given: Any) -> NDArray[Any]:
        chosen: NDArray[Any]
        if self.memory is None:
            chosen = choose(*given)
        else:
            chosen, self.memory = choose(*given, self.memory)
        return chosen


def draw_discrete(logits: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw one action a row by softmax(logits), by the Gumbel trick: int64[M] from float32[M, A]."""
    return np.asarray(np.argmax(logits + gumbel(logits.shape, rng), axis=-1))


def gumbel(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw from the standard Gumbel distribution: -log(E), where E is a standard exponential."""
    exponential = rng.standard_exponential(shape, dtype=np.float32)
    exponential += np.float32(1e-30)  # an exact 0 would win against any logit
    return np.asarray(-np.log(exponential))
