"""The worlds of our own trainers: several simulators of different layouts and robot counts, stepped as one block.

A world is reset after a fixed number of steps, with a seed that depends only on (training seed, world, episode). The
ends are spread evenly over time, so that a batch holds fresh and crowded worlds. The actions since the last resets are
therefore enough to restore the state; a checkpoint keeps them.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from train.books import book_of
from train.learning.config import HELD_OUT_SEED
from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.simulation.senses.rewards import REWARD_TERMS
from warehouse_env.simulation.simulator import Simulator

_COLLISION, _CONTACT = REWARD_TERMS.index("collision"), REWARD_TERMS.index("contact")
_JAM_SHARE = 0.2  # of a world's robots
_ENDS = 50  # worlds that ended last, of which the share of jammed ones is told
NEAR = np.float32(6.0)  # [m] within which robots share rewards


class TrainingSimulator(Simulator):
    """Worlds whose episodes end at different times, and early in a jam, where little is learned.

    Attributes:
        stuck: robots that in the last step had not come forward for `stuck_after` of the config.
        ends: for each world that ended with the last step, whether it had jammed.
    """

    def __init__(self, config: EnvConfig, num_worlds: int, jam_seconds: float, shared: float) -> None:
        """Make the worlds.

        Args:
            config: of the environment; its max_steps bounds an episode.
            num_worlds: how many.
            jam_seconds: a world is truncated once a fifth of its robots have not come forward for this long [s].
            shared: share of a reward that is the mean over all robots within NEAR, itself among them.
        """
        super().__init__(config, num_worlds, routes=book_of(config))
        self._shared = np.float32(shared)
        self._jam_seconds = jam_seconds
        self.stuck, self.ends = 0, list[bool]()

    def reset(self, seed: int | Sequence[int] | None = None) -> NDArray[np.float32]:
        """Start all worlds as `Simulator.reset` does, but spread the ends of their first episodes evenly."""
        observation = super().reset(seed)
        self.steps += self.config.max_steps * np.arange(self.num_worlds) // self.num_worlds
        return observation

    def step(self, actions: ArrayLike) -> NDArray[np.float32]:
        """Step all worlds as `Simulator.step` does; `truncated` also tells the jammed ones.

        A robot with the command to stand pays nothing for a contact, nor for a collision if it stood already: otherwise
        giving way first would not pay.
        """
        stood = self.state.speed == 0
        observation = super().step(actions)
        told = (self.events.touching != 0) & (self.robots["commanded"]["target_speed"] == 0)
        self.reward[told] -= self.reward_terms[told, _CONTACT]
        hit = told & stood
        self.reward[hit] -= self.reward_terms[hit, _COLLISION]
        if self._shared > 0.0:
            self.reward += self._shared * (self._mean_near() - self.reward)
        stalled = self.robots["clocks"]["stalled_time"]
        jammed = (stalled > self._jam_seconds).mean(axis=1) > _JAM_SHARE
        self.truncated |= jammed
        self.stuck, self.ends = int((stalled > self.config.stuck_after).sum()), jammed[self.truncated].tolist()
        return observation

    def _mean_near(self) -> NDArray[np.float32]:
        """Return each robot's mean reward over those within NEAR of it, float32[B, N]."""
        x, y = self.robots["motion"]["x"], self.robots["motion"]["y"]
        dx, dy = x[:, :, None] - x[:, None, :], y[:, :, None] - y[:, None, :]
        near = dx * dx + dy * dy < NEAR * NEAR
        mean: NDArray[np.float32] = (near * self.reward[:, None, :]).sum(axis=2) / near.sum(axis=2, dtype=np.float32)
        return mean


@dataclass
class Counts:
    """Sums over agent-steps; pairs count once."""

    steps: int = 0
    goals: int = 0
    collisions: float = 0.0
    metres: float = 0.0
    driven: float = 0.0  # [m], for the goals reached
    planned: float = 0.0  # [m], likewise
    reward: float = 0.0
    stuck: int = 0
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

    def __init__(self, simulators: Sequence[TrainingSimulator]) -> None:
        self._simulators = simulators
        self._counts = Counts()
        self._ends = deque[bool](maxlen=_ENDS)

    def add(self) -> None:
        """Count the step just made."""
        counts = self._counts
        for simulator in self._simulators:
            events = simulator.events
            counts.steps += events.arrived.size
            counts.goals += int(events.arrived.sum())
            counts.collisions += float(events.hit_robot.sum()) / 2 + float(events.hit_shelf.sum())
            counts.collisions += float(events.hit_person.sum())
            counts.metres += float(events.driven.sum(dtype=np.float64))
            counts.reward += float(simulator.reward.sum())
            counts.driven += sum(arrival.driven for arrival in simulator.arrivals)
            counts.planned += sum(arrival.planned for arrival in simulator.arrivals)
            counts.stuck += simulator.stuck
            self._ends.extend(simulator.ends)

    def take(self) -> Counts:
        """Return the counts since the last call, and start again from 0."""
        counts, self._counts = self._counts, Counts()
        counts.ends = tuple(self._ends)  # few end between two calls, so the last ones of before count again
        return counts


class TrainingWorlds:
    """Rows are the robots of all worlds of all simulators, in order.

    Attributes:
        observation: float32[rows, D], of the worlds as they now stand.
        reward: float32[rows], of the last step.
        tally: counts of goals, collisions and metres.
    """

    def __init__(
        self,
        mixes: Sequence[tuple[EnvConfig, int]],
        seed: list[int],
        jam_seconds: float,
        shared: float = 0.0,
    ) -> None:
        """Make and reset all worlds.

        Args:
            mixes: environments with the number of worlds of each; all with the same observation, action and max_steps.
            seed: of the training, and what tells these worlds from others.
            jam_seconds: a world is reset early once a fifth of its robots have not come forward for this long [s].
            shared: see TrainingSimulator.
        """
        self.simulators = [TrainingSimulator(*one, jam_seconds, shared) for one in mixes]
        config = mixes[0][0]
        self.tally = TrainingTally(self.simulators)
        self._seed = seed
        self._world = [(s, w) for s, (_, worlds) in enumerate(mixes) for w in range(worlds)]
        sizes = [simulator.num_worlds * simulator.num_agents for simulator in self.simulators]
        starts = np.concatenate([[0], np.cumsum(sizes)])
        self._blocks = [slice(int(a), int(b)) for a, b in itertools.pairwise(starts)]
        self.rows = int(starts[-1])
        self.observation = np.zeros((self.rows, self.simulators[0].layout.size), np.float32)
        self.reward = np.zeros(self.rows, np.float32)
        self._actions: deque[NDArray[Any]] = deque(maxlen=config.max_steps)
        self._episode = np.zeros(len(self._world), np.int64)
        for number, simulator in enumerate(self.simulators):
            simulator.reset([self._world_seed(w) for w, (s, _) in enumerate(self._world) if s == number])
        self._observe()

    def _world_seed(self, world: int) -> int:
        """Return the seed of a world's present episode, below the held-out ones."""
        entropy = [*self._seed, world, int(self._episode[world])]
        return int(np.random.SeedSequence(entropy).generate_state(1)[0]) % HELD_OUT_SEED

    def world_rows(self, world: int) -> slice:
        """Return the rows of one world, counted over all simulators."""
        number, index = self._world[world]
        robots = self.simulators[number].num_agents
        start = self._blocks[number].start + index * robots
        return slice(start, start + robots)

    def _reset_world(self, world: int, age: int = 0) -> None:
        number, index = self._world[world]
        self.simulators[number].reset_world(index, self._world_seed(world))
        self.simulators[number].steps[index] = age

    def _observe(self) -> None:
        for simulator, block in zip(self.simulators, self._blocks, strict=True):
            self.observation[block] = simulator.observation.reshape(-1, self.observation.shape[1])

    def _step_simulators(self, actions: NDArray[Any]) -> None:
        for simulator, block in zip(self.simulators, self._blocks, strict=True):
            shape = (simulator.num_worlds, simulator.num_agents, *actions.shape[1:])
            simulator.step(actions[block].reshape(shape))

    def step(self, actions: NDArray[Any]) -> list[tuple[slice, NDArray[np.float32]]]:
        """Step all worlds once with actions [rows] or [rows, 2].

        Returns the rows of the worlds that ended with this step, each with its last observation; in `observation`
        they hold already the first one of their next episode.
        """
        self._actions.append(actions.copy())
        self._step_simulators(actions)
        for simulator, block in zip(self.simulators, self._blocks, strict=True):
            self.reward[block] = simulator.reward.ravel()
        self.tally.add()
        self._observe()
        return self._end_worlds()

    def _end_worlds(self) -> list[tuple[slice, NDArray[np.float32]]]:
        ended = []
        for world in np.flatnonzero(np.concatenate([simulator.truncated for simulator in self.simulators])).tolist():
            rows = self.world_rows(world)
            ended.append((rows, self.observation[rows].copy()))
            self._episode[world] += 1
            self._reset_world(world)
            number, index = self._world[world]
            self.observation[rows] = self.simulators[number].observation[index]
        return ended

    def set_reward(self, weights: RewardWeights) -> None:
        """Change the reward weights of all worlds from the next step on."""
        for simulator in self.simulators:
            simulator.reward_weights = weights

    def history(self) -> dict[str, NDArray[Any]]:
        """Return what `replay` needs: the last actions, and every world's age in steps and episode number."""
        age = np.concatenate([simulator.steps for simulator in self.simulators])
        actions = np.stack(self._actions) if self._actions else np.empty(0)
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
                self._actions.append(actions[step])
                self._step_simulators(actions[step])
        self._observe()
