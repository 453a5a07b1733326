"""The worlds of our own trainers: several simulators of different layouts and robot counts, stepped as one block.

A world is reset after a fixed number of steps, with a seed that depends only on (training seed, world, episode). The
ends are spread evenly over time, so that a batch holds fresh and crowded worlds. The actions since the last resets are
therefore enough to restore the state; a checkpoint keeps them. The floors of `seed=new` follow from the number of steps
(floors.py). Rewards and counts are written for arrays and for a device's tensors alike (device_worlds.py).
"""

import itertools
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from train.books import book_of
from train.learning.config import HELD_OUT_SEED
from train.learning.floors import FloorSchedule
from train.learning.progress import TrainingTally
from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.observation import observation_layout
from warehouse_env.routes.book import RouteBook
from warehouse_env.simulation.given import Seeds
from warehouse_env.simulation.senses.rewards import REWARD_TERMS
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment

_COLLISION, _CONTACT = REWARD_TERMS.index("collision"), REWARD_TERMS.index("contact")
_LATE = 0.25  # of the predicted time: 0.6 s
_JAM_SHARE = 0.2  # of a world's robots
NEAR = 6.0  # [m] within which robots share rewards


def spread_ends(steps: NDArray[np.int64], max_steps: int) -> None:
    """Give worlds that have just been reset ages from 0 to nearly max_steps, so that their episodes end evenly."""
    steps += max_steps * np.arange(len(steps)) // len(steps)


def shape_reward(reward: Any, terms: Any, robots: Any, stood: Any, shared: float) -> None:
    """Change the rewards of a step in place, for training; arrays or tensors.

    A robot with the command to stand pays nothing for a contact, nor for a collision if it stood already: otherwise
    giving way first would not pay.

    reward: float32[B, N], the sum of terms float32[B, N, T]. robots: ROBOT[B, N] after the step, or its fields. stood:
    bool[B, N], before the step. shared: share of a reward that is the mean over all robots within NEAR, its own among
    them.
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


def price_late_braking(reward: Any, observation: Any, robots: Any, config: EnvConfig, price: float) -> None:
    """Add `price` for each metre driven from where even braking is predicted to touch, in place; arrays or tensors.

    reward: float32[B, N]; observation: float32[B, N, D]; robots: ROBOT[B, N] after the step, or its fields.
    """
    standing = config.speed_levels.index(0.0) * len(config.lateral_offsets)
    free = observation[..., observation_layout(config).slices["predictions"].start + standing]
    metres = abs(robots["motion"]["speed"]) * (config.time_step * config.action_repeat)
    reward += price * metres * (free <= _LATE)


def jammed_worlds(robots: Any, jam_seconds: float) -> Any:
    """Return bool[B]: whether a fifth of a world's robots have not come forward for this long [s]."""
    stalled = robots["clocks"]["stalled_time"] > jam_seconds
    return stalled.sum(1) > _JAM_SHARE * stalled.shape[1]


class TrainingSimulator(Simulator):
    """Worlds whose episodes end at different times, and early in a jam, where little is learned.

    fields: ROBOT[B, N]. stuck: robots that in the last step had not come forward for `stuck_after` of the config. ends:
    for each world that ended with the last step, whether it had jammed.
    """

    def __init__(
        self, config: EnvConfig, num_worlds: int, jam_seconds: float, shared: float, routes: RouteBook | None = None,
        late_braking: float = 0.0,
    ) -> None:  # fmt: skip
        """Make the worlds, whose episodes last max_steps of the config at most.

        jam_seconds: a world is truncated once a fifth of its robots have not come forward for this long [s]. shared:
        see shape_reward. routes: shared with other simulators on the floor. late_braking: see price_late_braking.
        """
        super().__init__(config, num_worlds, routes=routes)
        self._shared, self._jam_seconds, self.fields, self._late = shared, jam_seconds, self.robots, late_braking
        self.stuck, self.ends = 0, list[bool]()

    def reset(self, seed: Seeds = None, assignments: Sequence[Assignment] | None = None) -> NDArray[np.float32]:
        """Start all worlds as `Simulator.reset` does, but spread the ends of their first episodes evenly."""
        observation = super().reset(seed, assignments)
        spread_ends(self.steps, self.config.max_steps)
        return observation

    def step(self, actions: ArrayLike) -> NDArray[np.float32]:
        """Step all worlds as `Simulator.step` does; `reward` is shaped, and `truncated` also tells the jammed ones."""
        stood = self.robots["motion"]["speed"] == 0
        observation = super().step(actions)
        shape_reward(self.reward, self.reward_terms, self.robots, stood, self._shared)
        if self._late:
            price_late_braking(self.reward, observation, self.robots, self.config, self._late)
        jammed = jammed_worlds(self.robots, self._jam_seconds)
        self.truncated |= jammed
        self.ends = jammed[self.truncated].tolist()
        self.stuck = int((self.robots["clocks"]["stalled_time"] > self.config.stuck_after).sum())
        return observation

    def lengths(self) -> tuple[float, float]:
        """Return the [m] driven and planned of the tasks finished in the last step."""
        return sum(one.driven for one in self.arrivals), sum(one.planned for one in self.arrivals)


class TrainingWorlds:
    """Rows are the robots of all worlds of all simulators, in order.

    observation: float32[rows, D], of the worlds as they now stand. reward: float32[rows], of the last step. tally:
    counts of goals, collisions and metres.
    """

    replays = True  # its last actions restore the state

    def __init__(
        self, make: Callable[..., Any], mixes: Sequence[tuple[EnvConfig, int]], seed: list[int], floor_episodes: int = 1
    ) -> None:
        """Make and reset all worlds.

        make: from an environment, a number of worlds and `routes` to a TrainingSimulator. mixes: environments and
        worlds of each; all with the same observation, action and max_steps. seed: of the training, and what tells these
        worlds from others. floor_episodes: of max_steps, after which a layout with `seed=new` gets a new floor.
        """
        self._make, self._seed, self._floors = make, seed, FloorSchedule(mixes, seed, floor_episodes)
        counts = [worlds for _, worlds in self._floors.mixes]
        self._first = np.cumsum([0, *counts]).tolist()  # world of each simulator
        self._world = [(number, world) for number, worlds in enumerate(counts) for world in range(worlds)]
        self._episode = np.zeros(len(self._world), np.int64)
        self.simulators = simulators = [self._simulator(number) for number in range(len(counts))]
        self.tally = TrainingTally(simulators)
        starts = np.cumsum([0, *(simulator.num_worlds * simulator.num_agents for simulator in simulators)]).tolist()
        self._blocks = [slice(a, b) for a, b in itertools.pairwise(starts)]
        self.rows = starts[-1]
        seen = torch.as_tensor(simulators[0].observation)
        self.observation, self.reward = seen.new_zeros((self.rows, seen.shape[-1])), seen.new_zeros(self.rows)
        self._actions = deque[Tensor](maxlen=simulators[0].config.max_steps if self.replays else 0)
        self._observe()

    def _simulator(self, number: int) -> Any:
        """Return a new simulator on the floor that is due, with its worlds reset."""
        env = self._floors.env(number)
        routes = None if number in self._floors.drawn else book_of(env)  # so a drawn floor's routes end with it
        simulator = self._make(env, self._floors.mixes[number][1], routes=routes)
        simulator.reset([self._world_seed(world) for world in range(*self._first[number : number + 2])])
        return simulator

    def _change_floor(self, number: int) -> None:
        old, new = self.simulators[number], self._simulator(number)
        new.steps[:], new.reward_weights = 0, old.reward_weights
        self.simulators[number] = new

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
        self._floors.steps += 1
        for simulator, block in zip(self.simulators, self._blocks, strict=True):
            self.reward[block] = torch.as_tensor(simulator.reward).flatten()
        self.tally.add()
        self._observe()
        return self._end_worlds()

    def _end_worlds(self) -> list[tuple[Tensor, Tensor]]:
        ended, due = [], []
        for number, (simulator, block) in enumerate(zip(self.simulators, self._blocks, strict=True)):
            floor_ends, robots = self._floors.ends(number), simulator.num_agents
            worlds = np.flatnonzero(simulator.truncated | floor_ends)
            if len(worlds):
                rows = torch.from_numpy((block.start + worlds[:, None] * robots + np.arange(robots)).ravel())
                rows = rows.to(self.observation.device)
                ended.append((rows, self.observation[rows]))
                if floor_ends:
                    self._episode[self._first[number] + worlds] += 1
                    self._change_floor(number)
                else:
                    due.append((number, worlds))
        self._restart(due)
        if ended:
            self._observe()
        return ended

    def _restart(self, due: Sequence[tuple[int, NDArray[np.int64]]]) -> None:
        """Begin the next episodes of some worlds of some simulators."""
        for number, worlds in due:
            for world in (self._first[number] + worlds).tolist():
                self._episode[world] += 1
                self._reset_world(world)

    def set_reward(self, weights: RewardWeights) -> None:
        """Change the reward weights of all worlds from the next step on."""
        for simulator in self.simulators:
            simulator.reward_weights = weights

    def history(self) -> dict[str, NDArray[Any]]:
        """Return what `replay` needs: last actions, steps so far, and each world's age in steps and episode number."""
        age = np.concatenate([simulator.steps for simulator in self.simulators])
        actions = torch.stack(list(self._actions)).numpy() if self._actions else np.empty(0)
        steps = np.array([self._floors.steps])
        return {"actions": actions, "age": age, "episode": self._episode.copy(), "steps": steps}

    def replay(self, history: dict[str, NDArray[Any]]) -> None:
        """Bring all worlds, just made with the same arguments, to where they stood when `history` was taken."""
        actions, age = history["actions"], history["age"]
        self._episode[:] = history["episode"]
        self._floors.steps = int(history.get("steps", [0])[0])  # not in files of versions that drew no floors
        for number in self._floors.drawn:
            self._change_floor(number)
        begun = np.where(self._episode > 0, len(actions) - age, 0)  # the step before which a world was last reset
        for step in range(len(actions) + 1):
            for world in np.flatnonzero(begun == step).tolist():
                # a first episode begins with some age, on which contacts, too, are dated
                self._reset_world(world, int(age[world] - (len(actions) - step)))
            if step < len(actions):
                self._actions.append(torch.from_numpy(actions[step]))
                self._step_simulators(self._actions[-1])
        self._observe()
