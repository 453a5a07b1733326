"""What a recorded episode shows of its robots, moment by moment, found by running it again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.replay import FLAGS, Replay, replay_of
from warehouse_env.simulation.record.recording import Episode
from warehouse_env.simulation.tasks.duty import Doing


class Story(NamedTuple):
    """One world of N robots at F moments."""

    replay: Replay
    charge: NDArray[np.float64]  # [F, N], share of a full battery; 1 where none is simulated
    charging: NDArray[np.bool_]  # [F, N]
    serving: NDArray[np.bool_]  # [F, N], being loaded or unloaded

    def flag(self, name: str) -> NDArray[np.bool_]:
        """Return bool[F, N], one of the replay's FLAGS."""
        return np.asarray((self.replay.flags >> FLAGS.index(name)) & 1, dtype=np.bool_)


class _Watched:
    """An episode that notes batteries and service while it runs again."""

    def __init__(self, episode: Episode, world: int) -> None:
        self._episode, self._world = episode, world
        self.config: EnvConfig = episode.config
        self.grid: GridMap = episode.grid
        self.seeds, self.pose = episode.seeds, episode.pose
        self.work: list[tuple[Any, Any, Any]] = []

    def replay(self) -> Iterator[Any]:
        """Yield the simulator after the reset and after every step."""
        none = np.zeros(self.config.num_agents, np.bool_)
        for simulator in self._episode.replay():
            shifts = simulator.dispatcher.shifts
            if shifts is None:
                self.work.append((~none, none, none))
            else:
                shift = shifts[self._world]
                doing = [duty.doing for duty in shift.duties]
                share = ~none if shift.batteries is None else shift.batteries.share.copy()
                charging, serving = (np.array([one == what for one in doing]) for what in (Doing.CHARGES, Doing.SERVED))
                self.work.append((share, charging, serving))
            yield simulator


def story_of(episode: Episode, world: int = 0, moved: Callable[[], object] = lambda: None) -> Story:
    """Run one world of an episode again; WarehouseError if its poses differ."""
    watched = _Watched(episode, world)
    replay = replay_of(watched, "fleet", None, world, moved)
    charge, charging, serving = (np.array(column) for column in zip(*watched.work, strict=True))
    return Story(replay, charge.astype(np.float64), charging, serving)
