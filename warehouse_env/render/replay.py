"""An episode as arrays to be looked at: what the replay page shows of one world, gathered by running it again."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig, RewardWeights
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap

Shares = Callable[[NDArray[np.float32]], NDArray[np.float32]]
"""How much a policy likes each action: shares in [0, 1] float32[1, N, A] from observations float32[1, N, D]."""

REWARD_TERMS = tuple(field.name for field in dataclasses.fields(RewardWeights))
FLAGS = ("alive", "loaded", "touching", "deadlocked", "arrived", "hit_robot", "hit_shelf", "near_miss")
_STRAIGHT = 0.006  # [rad] by which a route turns at a way-point that is kept, about a third of a degree


class Recorded(Protocol):
    """An `Episode` of simulation/recording.py, which can be run again."""

    config: EnvConfig
    grid: GridMap
    seeds: tuple[int, ...]
    actions: NDArray[Any]
    pose: NDArray[np.float32]

    def replay(self) -> Iterator[Any]:
        """Yield the simulator after the reset and after every step."""
        ...


@dataclass(frozen=True, eq=False)
class Replay:
    """One world of N robots at F moments: after the reset, and after each of F - 1 steps."""

    name: str
    grid: GridMap
    config: EnvConfig
    seed: int
    pose: NDArray[np.float32]  # [F, N, 3] front axle x [m], y [m], heading [rad]
    speed: NDArray[np.float32]  # [F, N] [m/s]
    steer: NDArray[np.float32]  # [F, N] [rad], of the steered wheels
    goal: NDArray[np.int32]  # [F, N], row * columns + column of the cell
    flags: NDArray[np.uint8]  # [F, N], bit k is FLAGS[k]
    waits_for: NDArray[np.int32]  # [F, N], whom a standing robot waits for, else -1
    yields_to: NDArray[np.int32]  # [F, N], whom the right of way makes it give way to, else -1
    held_by: NDArray[np.int32]  # [F, N], before whom the protective field brakes it, else -1
    rewards: NDArray[np.float32]  # [F, N, R], the weighed terms of the step before, in the order of REWARD_TERMS
    routes: tuple[NDArray[np.float32], ...]  # each [K, 2] [m]
    route: NDArray[np.int32]  # [F, N], which of the routes it drives
    along: NDArray[np.float32]  # [F, N] [m] reached on it
    liked: NDArray[np.float32] | None = None  # [F, N, A] in [0, 1], the policy's preferences over actions

    @property
    def seconds(self) -> float:
        """Simulated time between two moments [s]."""
        return self.config.action_repeat * self.config.time_step


def replay_of(episode: Recorded, name: str, policy: Shares | None = None, world: int = 0) -> Replay:
    """Run an episode again and keep what is to be seen of one world; policy: to be asked at every moment.

    Raises ConfigError for a world that the episode does not have.
    """
    raise NotImplementedError
