"""The worlds of our own trainers: several simulators of different layouts and robot counts, stepped as one block.

A world is reset after a fixed number of steps, with a seed that depends only on (training seed, world, episode). The
ends are spread evenly over time, so that a batch holds fresh and crowded worlds. The actions since the last resets are
therefore enough to restore the state; a checkpoint keeps them. Rewards and counts are written for arrays and for a
device's tensors alike (device_worlds.py).
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from train.books import book_of
from train.learning.config import HELD_OUT_SEED
from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.simulation.senses.rewards import REWARD_TERMS
from warehouse_env.simulation.simulator import Simulator

_COLLISION, _CONTACT = REWARD_TERMS.index("collision"), REWARD_TERMS.index("contact")
_JAM_SHARE = 0.2  # of a world's robots
_ENDS = 50  # worlds that ended last, of which the share of jammed ones is told
NEAR = 6.0  # [m] within which robots share rewards


def spread_ends(steps: NDArray[np.int64], max_steps: int) -> None:
    """Give worlds that have just been reset ages from 0 to nearly max_steps, so that their episodes end evenly."""
    steps += max_steps * np.arange(len(steps)) // len(steps)


def shape_reward(reward: Any, terms: Any, robots: Any, stood: Any, shared: float) -> None:
    """Change the rewards of a step in place, for training; arrays or tensors.

    A robot with the command to stand pays nothing for a contact, nor for a collision if it stood already: otherwise
    giving way first would not pay.

    Args:
        reward: float32[B, N].
        terms: float32[B, N, T], of which it is the sum.
        robots: ROBOT[B, N] after the step, or its fields.
        stood: bool[B, N], whether each robot stood before the step.
        shared: share of a reward that is the mean over all robots within NEAR, itself among them.
    """
    told = (robots["events"]["touching"] != 0) & (robots["commanded"]["target_speed"] == 0)
    reward -= told * terms[..., _CONTACT]
    reward -= (told & stood) * terms[..., _COLLISION]
    if shared > 0.0:
        x, y = robots["motion"]["x"], robots["motion"]["y"]
        dx, dy = x[:, :, None] - x[:, None, :], y[:, :, None] - y[:, None, :]
        near = dx * dx + dy * dy < NEAR * NEAR
        mean = (near * reward[:, None, :]).sum(2)
        mean /= near.sum(2)
        reward += shared * (mean - reward)


def jammed_worlds(robots: Any, jam_seconds: float) -> Any:
    """Return bool[B]: whether a fifth of a world's robots have not come forward for this long [s]."""
    stalled = robots["clocks"]["stalled_time"] > jam_seconds
    return stalled.sum(1) > _JAM_SHARE * stalled.shape[1]


class TrainingSimulator(Simulator):
    """Worlds whose episodes end at different times, and early in a jam, where little is learned.

    Attributes:
        fields: ROBOT[B, N].
        stuck: robots that in the last step had not come forward for `stuck_after` of the config.
        ends: for each world that ended with the last step, whether it had jammed.
    """

    def __init__(self, config: EnvConfig, num_worlds: int, jam_seconds: float, shared: float) -> None:
        """Make the worlds.

        Args:
            config: of the environment; its max_steps bounds an episode.
            num_worlds: how many.
            jam_seconds: a world is truncated once a fifth of its robots have not come forward for this long [s].
            shared: see shape_reward.
        """
        super().__init__(config, num_worlds, routes=book_of(config))
        self._shared, self._jam_seconds, self.fields = shared, jam_seconds, self.robots
        self.stuck, self.ends = 0, list[bool]()

    def reset(self, seed: int | Sequence[int] | None = None) -> NDArray[np.float32]:
        """Start all worlds as `Simulator.reset` does, but spread the ends of their first episodes evenly."""
        observation = super().reset(seed)
        spread_ends(self.steps, self.config.max_steps)
        return observation

    def step(self, actions: ArrayLike) -> NDArray[np.float32]:
        """Step all worlds as `Simulator.step` does; `reward` is shaped, and `truncated` also tells the jammed ones."""
        stood = self.robots["motion"]["speed"] == 0
        observation = super().step(actions)
        shape_reward(self.reward, self.reward_terms, self.robots, stood, self._shared)
        jammed = jammed_worlds(self.robots, self._jam_seconds)
        self.truncated |= jammed
        self.ends = jammed[self.truncated].tolist()
        self.stuck = int((self.robots["clocks"]["stalled_time"] > self.config.stuck_after).sum())
        return observation

    def lengths(self) -> tuple[float, float]:
        """Return the [m] driven and planned of the tasks finished in the last step."""
        return sum(one.driven for one in self.arrivals), sum(one.planned for one in self.arrivals)


@dataclass
class Counts:
    """Sums over agent-steps; pairs count once."""

    steps: float = 0.0
    goals: float = 0.0
    collisions: float = 0.0
    metres: float = 0.0
    driven: float = 0.0  # [m], for the goals reached
    planned: float = 0.0  # [m], likewise
    reward: float = 0.0
    stuck: float = 0.0
    ends: tuple[bool, ...] = ()  # of the last worlds that ended, whether each had jammed

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def figures(self, decision_seconds: float) -> dict[str, float]:
        """Return what the progress bar and the log show."""
        hours = self.steps * decision_seconds / 3600.0
        return {
            "reward": self.reward / max(self.steps, 1),
            "goals_per_robot_hour": self.goals / hours if hours else 0.0,
            "collisions_per_km": 1000.0 * self.collisions / max(self.metres, 1.0),
            "path_length_ratio": self.driven / max(self.planned, 1.0),
            "stuck": self.stuck / max(self.steps, 1),
            "worlds_jammed": sum(self.ends) / max(len(self.ends), 1),  # a share of
            "worlds_ended": float(len(self.ends)),
        }


class TrainingTally:
    """Counts what happens in some simulators."""

    def __init__(self, simulators: Sequence[Any]) -> None:
        self._simulators = simulators
        self._counts = Counts()
        self._ends = deque[bool](maxlen=_ENDS)

    def add(self) -> None:
        """Count the step just made; on a device without waiting for it."""
        counts = self._counts
        for simulator in self._simulators:
            events = simulator.fields["events"]
            counts.steps += simulator.num_worlds * simulator.num_agents
            counts.goals += events["arrived"].sum()
            counts.collisions += events["hit_robot"].sum() / 2 + events["hit_shelf"].sum() + events["hit_person"].sum()
            counts.metres += events["driven"].sum()
            counts.reward += simulator.reward.sum()
            driven, planned = simulator.lengths()
            counts.driven += driven
            counts.planned += planned
            counts.stuck += simulator.stuck
            self._ends.extend(simulator.ends)

    def take(self) -> Counts:
        """Return the counts since the last call, and start again from 0."""
        *sums, _ = astuple(self._counts)
        self._counts = Counts()
        taken = Counts(*map(float, sums))  # type: ignore[arg-type]
        taken.ends = tuple(self._ends)  # few end between two calls, so the last ones of before count again
        return taken


class TrainingWorlds:
    """Rows are the robots of all worlds of all simulators, in order.

    Attributes:
        observation: float32[rows, D], of the worlds as they now stand.
        reward: float32[rows], of the last step.
        tally: counts of goals, collisions and metres.
    """

    replays = True  # its last actions restore the state

    def __init__(self, simulators: Sequence[Any], seed: list[int]) -> None:
        """Reset all worlds.

        Args:
            simulators: TrainingSimulators; all with the same observation, action and max_steps.
            seed: of the training, and what tells these worlds from others.
        """
        self.simulators, self._seed = simulators, seed
        self.tally = TrainingTally(simulators)
        self._first = np.cumsum([0, *(simulator.num_worlds for simulator in simulators)]).tolist()  # world of each
        self._world = [(s, w) for s, simulator in enumerate(simulators) for w in range(simulator.num_worlds)]
        starts = np.cumsum([0, *(simulator.num_worlds * simulator.num_agents for simulator in simulators)]).tolist()
        self._blocks = [slice(a, b) for a, b in itertools.pairwise(starts)]
        self.rows = starts[-1]
        seen = torch.as_tensor(simulators[0].observation)
        self.observation, self.reward = seen.new_zeros((self.rows, seen.shape[-1])), seen.new_zeros(self.rows)
        self._actions = deque[Tensor](maxlen=simulators[0].config.max_steps if self.replays else 0)
        self._episode = np.zeros(len(self._world), np.int64)
        for number, simulator in enumerate(simulators):
            simulator.reset([self._world_seed(world) for world in range(*self._first[number : number + 2])])
        self._observe()

    def _world_seed(self, world: int) -> int:
        """Return the seed of a world's present episode, below the held-out ones."""
        entropy = [*self._seed, world, int(self._episode[world])]
        return int(np.random.SeedSequence(entropy).generate_state(1)[0]) % HELD_OUT_SEED

    def _reset_world(self, world: int, age: int = 0) -> None:
        number, index = self._world[world]
        self.simulators[number].reset_world(index, self._world_seed(world))
        self.simulators[number].steps[index] = age

    def _observe(self) -> None:
        for simulator, block in zip(self.simulators, self._blocks, strict=True):
            self.observation[block] = torch.as_tensor(simulator.observation).flatten(0, 1)

    def _step_simulators(self, actions: Tensor) -> None:
        for simulator, block in zip(self.simulators, self._blocks, strict=True):
            simulator.step(actions[block].reshape(simulator.num_worlds, simulator.num_agents, *actions.shape[1:]))

    def step(self, actions: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Step all worlds once with actions [rows] or [rows, 2].

        Returns the rows of the worlds that ended with this step, with their last observations; in `observation` they
        hold already the first one of their next episode.
        """
        self._actions.append(actions.clone())
        self._step_simulators(actions)
        for simulator, block in zip(self.simulators, self._blocks, strict=True):
            self.reward[block] = torch.as_tensor(simulator.reward).flatten()
        self.tally.add()
        self._observe()
        return self._end_worlds()

    def _end_worlds(self) -> list[tuple[Tensor, Tensor]]:
        ended = []
        for number, (simulator, block) in enumerate(zip(self.simulators, self._blocks, strict=True)):
            worlds, robots = np.flatnonzero(simulator.truncated), simulator.num_agents
            if len(worlds):
                rows = torch.from_numpy((block.start + worlds[:, None] * robots + np.arange(robots)).ravel())
                rows = rows.to(self.observation.device)
                ended.append((rows, self.observation[rows]))
                self._restart(number, worlds)
        if ended:
            self._observe()
        return ended

    def _restart(self, number: int, worlds: NDArray[np.int64]) -> None:
        for world in (self._first[number] + worlds).tolist():
            self._episode[world] += 1
            self._reset_world(world)

    def set_reward(self, weights: RewardWeights) -> None:
        """Change the reward weights of all worlds from the next step on."""
        for simulator in self.simulators:
            simulator.reward_weights = weights

    def history(self) -> dict[str, NDArray[Any]]:
        """Return what `replay` needs: the last actions, and every world's age in steps and episode number."""
        age = np.concatenate([simulator.steps for simulator in self.simulators])
        actions = torch.stack(list(self._actions)).numpy() if self._actions else np.empty(0)
        return {"actions": actions, "age": age, "episode": self._episode.copy()}

    def replay(self, history: dict[str, NDArray[Any]]) -> None:
        """Bring all worlds, just made with the same arguments, to where they stood when `history` was taken."""
        actions, age = history["actions"], history["age"]
        self._episode[:] = history["episode"]
        begun = np.where(self._episode > 0, len(actions) - age, 0)  # the step before which a world was last reset
        for step in range(len(actions) + 1):
            for world in np.flatnonzero(begun == step).tolist():
                # a first episode begins with some age, on which contacts, too, are dated
                self._reset_world(world, int(age[world] - (len(actions) - step)))
            if step < len(actions):
                self._actions.append(torch.from_numpy(actions[step]))
                self._step_simulators(self._actions[-1])
        self._observe()
