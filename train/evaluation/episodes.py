"""Experiments whose episodes are played as jobs."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from train.evaluation.jobs import Job, Result, Tick
from train.evaluation.places import PlaceNotes
from train.evaluation.rollout import Experiment, Watcher, identity, run
from train.reporting.rows import Row
from warehouse_env.simulation.simulator import Simulator

TICK = 50  # steps between two notes of progress
SIDE_BY_SIDE = 4  # most episodes of a job; more are no faster, and a stop would lose them


@dataclass(frozen=True)
class EpisodesJob(Job):
    """The episodes of an experiment. noted: note the places."""

    experiment: Experiment
    noted: bool = False

    times = ("ms_per_step",)

    @property
    def title(self) -> str:
        """The experiment and the numbers of its episodes."""
        first, *others = self.experiment.episodes
        return f"{self.experiment.title} · episode {first}" + (f" to {others[-1]}" if others else "")

    @property
    def identity(self) -> Row:
        """The fields that all rows share."""
        return identity(self.experiment)

    @property
    def size(self) -> float:
        """Steps of all episodes."""
        return float(self.experiment.config.max_steps * len(self.experiment.episodes))

    @property
    def files(self) -> tuple[str, ...]:
        """The policy, the planner, the floor and the orders."""
        config = self.experiment.config
        orders = (config.orders and config.orders.file) or ""
        return self.experiment.policy, config.planner, config.layout, orders

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Self | None]:
        """Return the valid rows, and a job for the missing episodes."""
        one = self.experiment
        by_seed = {row["seed"]: row for row in rows if isinstance(row.get("seed"), int)}
        drawn = ((k, by_seed.get(one.seed + k, {})) for k in one.episodes)
        found = {k: row for k, row in drawn if row.get("episode") == k}
        missing = tuple(k for k in one.episodes if k not in found)
        rest = dataclasses.replace(self, experiment=dataclasses.replace(one, episodes=missing)) if missing else None
        return [found[k] for k in one.episodes if k in found], rest

    def parts(self, most: float) -> list[Self]:
        """Return jobs of few episodes each."""
        one, count = self.experiment, len(self.experiment.episodes)
        each = max(1, min(SIDE_BY_SIDE, math.floor(most / one.config.max_steps)))
        return [
            dataclasses.replace(self, experiment=dataclasses.replace(one, episodes=one.episodes[first : first + each]))
            for first in range(0, count, each)
        ]

    def ticking(self, tick: Tick) -> Watcher:
        """Return a watcher that notes progress."""

        def watch(simulator: Simulator, steps: int) -> None:
            if steps % TICK == 0:
                tick(steps * simulator.num_worlds)

        return watch

    def run(self, tick: Tick) -> Result:
        """Play the episodes."""
        if not self.noted:
            return Result(run(self.experiment, [self.ticking(tick)]))
        places = PlaceNotes(self.experiment)
        return Result(run(self.experiment, [self.ticking(tick), places]), places.rows())
