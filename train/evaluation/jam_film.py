"""A jam that dissolves: the scene in which most robots stand at once and all arrive, and four moments of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.evaluation.rollout import config_of
from train.evaluation.scenes import SCENES, SceneJob
from train.evaluation.telling import Asked
from train.reporting.rows import Row
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.probability_maps import Moments, View
from warehouse_env.simulation.simulator import Simulator

STANDS = 5.0  # [s] within a metre of one place from which a robot counts as standing
ROUND = 1.8  # [m] of floor shown around the front axles of all that are not parked


class Frame(NamedTuple):
    """The robots after a step: pose [N, 3], speed [N] [m/s], chances [N, 4], alive [N], standing [N]."""

    seconds: float
    pose: NDArray[np.float32]
    speed: NDArray[np.float32]
    chances: NDArray[np.float64]
    alive: NDArray[np.bool_]
    standing: NDArray[np.bool_]


class Film:
    """A watcher that keeps every step of the first world, and what its robots were about to do."""

    def __init__(self, asked: Asked) -> None:
        self._asked = asked
        self.frames: list[Frame] = []
        self.grid: GridMap | None = None

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Keep the robots as they are."""
        self.grid = simulator.grid
        state, alive = simulator.state, simulator.state.alive[0] > 0
        chances = self._asked(simulator.observation[0])
        standing = alive & (simulator.robots["standing_time"][0] >= STANDS)
        seconds = simulator.seconds(0)
        self.frames.append(Frame(seconds, state.pose[0].copy(), state.speed[0].copy(), chances, alive, standing))

    @property
    def waiting(self) -> NDArray[np.int64]:
        """How many robots stand after each step, int64[T]."""
        return np.array([frame.standing.sum() for frame in self.frames])

    def telling(self) -> list[Frame]:
        """Return four frames: half of the most stand, the most stand, again half of them do, nobody does."""
        waiting = self.waiting
        most = int(waiting.max())
        peak = np.flatnonzero(waiting == most)
        worst = int(peak[len(peak) // 2])
        after = waiting[worst:]
        return [
            self.frames[k]
            for k in (
                int(np.argmax(2 * waiting >= most)),
                worst,
                worst + int(np.argmax(2 * after <= most)),
                worst + int(np.argmax(after == 0)),
            )
        ]


def worst_jam(
    policy: str,
    base: EnvConfig,
    seconds: float,
    seed: int,
    tick: Callable[[], None],
    chosen: Mapping[str, Any] = {},
) -> tuple[str, Film] | None:
    """Play every scene once; return name and film of the one, of those in which all arrive, where most stand at once.

    None if they all arrive nowhere. tick is called after each.
    """
    worst: tuple[str, Film] | None = None
    for name in SCENES:
        film = Film(Asked(policy, config_of(policy, base, chosen)))
        job = SceneJob(name, policy, base, seconds, range(seed, seed + 1), chosen)
        (row,) = job.run(lambda done: None, [film]).rows
        if row["resolved"] and (worst is None or film.waiting.max() > worst[1].waiting.max()):
            worst = name, film
        tick()
    return worst


def moments_of(film: Film, config: EnvConfig) -> Moments:
    """Return the telling moments of a film, and the part of the floor where robots stand or drive in them."""
    frames, grid = film.telling(), film.grid
    assert grid is not None
    pose = np.stack([frame.pose for frame in frames])
    driving = np.concatenate([frame.pose[frame.alive, :2] for frame in frames])
    low, high = driving.min(axis=0) - ROUND, driving.max(axis=0) + ROUND
    low, high = low.clip(0), high.clip(max=np.array(grid.shape[::-1]) * grid.cell_size)
    return Moments(
        grid, config.robot, np.array([frame.seconds for frame in frames]), pose,
        np.stack([frame.speed for frame in frames]), np.stack([1.0 - frame.chances[:, 0] for frame in frames]),
        np.stack([frame.alive for frame in frames]), View(float(low[0]), float(high[0]), float(low[1]), float(high[1])),
    )  # fmt: skip


def rows_of(one: Film) -> list[Row]:
    """Return a row for each robot in each of the telling moments: pose, speed, and its chances."""
    return [
        {
            "seconds": frame.seconds, "robot": i, "x": x, "y": y, "heading": heading, "speed": frame.speed[i],
            "alive": frame.alive[i], **dict(zip(Asked.CHANCES, frame.chances[i], strict=True)),
        }
        for frame in one.telling()
        for i, (x, y, heading) in enumerate(frame.pose)
    ]  # fmt: skip
