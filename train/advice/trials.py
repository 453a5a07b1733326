"""Trials: one episode each of robots under right of way by rules on a floor, which may be one that is only thought of.

All trials of a seed have the same starts and first goals where floors have the same endpoints, so they pair.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from train.evaluation.places import Places
from train.evaluation.rollout import OneBook, make_experiment, run
from train.reporting.rows import Row, RowFile
from warehouse_env import __version__
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning import make_planner
from warehouse_env.routes.book import RouteBook

POLICY = "greedy"  # right of way alone: no training, and no contact
_BOOKS: dict[tuple[str, str, str], RouteBook] = {}  # of this process, by floor, its content and planner
_IDENTITY = ("floor", "content", "robots", "seed", "planner", "asked_seconds", "version")

Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""A `map`, perhaps over processes."""


class Trial(NamedTuple):
    """An episode to be driven."""

    floor: str  # its name among those that are tried
    grid: GridMap
    robots: int
    seed: int
    seconds: float
    planner: str

    @property
    def identity(self) -> Row:
        """What its row is known by."""
        content = f"{self.grid.key} {self.grid.endpoints[2]}"
        values = (self.floor, content, self.robots, self.seed, self.planner, self.seconds, __version__)
        return dict(zip(_IDENTITY, values, strict=True))


def drive(trial: Trial) -> Row:
    """Drive an episode; return its row, together with what was noted of places."""
    env = EnvConfig(num_agents=trial.robots, planner=trial.planner)
    experiment = make_experiment(POLICY, env, 1, trial.seconds, trial.seed)
    key = (trial.floor, trial.grid.key, trial.planner)
    if key not in _BOOKS:
        _BOOKS[key] = RouteBook(trial.grid, make_planner(trial.planner), keep_right=experiment.config.keep_right)
    places = Places(experiment)
    (row,) = run(experiment, [places], OneBook(_BOOKS[key]))
    (note,) = places.rows()
    left_out = ("config", "layout", "deadlock_log", "episode")
    return {name: value for name, value in {**note, **row}.items() if name not in left_out} | trial.identity


class Trials:
    """Drives trials in processes, writes their rows as they end, and knows those that are written already."""

    def __init__(self, each: Each, file: RowFile, old: Sequence[Row], tick: Callable[[str], None]) -> None:
        """Open. tick: hears after each trial what is tried."""
        self._each, self._file, self._tick = each, file, tick
        self._known = {self._key(row): row for row in old if all(name in row for name in _IDENTITY)}

    @staticmethod
    def _key(row: Row) -> tuple[object, ...]:
        return tuple(row[name] for name in _IDENTITY)

    def drive(self, trials: Sequence[Trial], title: str) -> list[Row]:
        """Return the rows of trials in their order, those that are known not driven again."""
        missing = [trial for trial in trials if self._key(trial.identity) not in self._known]
        for row in self._each(drive, missing):
            self._file.add([row])
            self._known[self._key(row)] = row
            self._tick(title)
        return [self._known[self._key(trial.identity)] for trial in trials]


class Clock:
    """A budget of time, or none."""

    def __init__(self, minutes: float | None) -> None:
        self.restart()
        self._budget = None if minutes is None else 60.0 * minutes

    def restart(self) -> None:
        """Begin anew."""
        self._begin = time.monotonic()

    @property
    def spent(self) -> float:
        """Seconds since it was made, or restarted."""
        return time.monotonic() - self._begin

    @property
    def left(self) -> float:
        """Seconds of the budget that are left, infinite without one."""
        return math.inf if self._budget is None else self._budget - self.spent

    def allows(self, seconds: float, share: float = 1.0) -> bool:
        """Return whether so much more time stays within a share of the budget."""
        return self._budget is None or self.spent + seconds <= share * self._budget
