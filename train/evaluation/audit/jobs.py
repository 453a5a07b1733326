"""Jobs that audit a recorded episode, or the episodes of an experiment as they are driven."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from train.evaluation.audit.watcher import Audit
from train.evaluation.episodes import TICK, EpisodesJob
from train.evaluation.jobs import Job, Result, Tick
from train.evaluation.rollout import run
from train.reporting.rows import Row
from warehouse_env import __version__
from warehouse_env.files import whereabouts
from warehouse_env.simulation.record.recording import Episode

CHECKS = 1  # version of the checks: rows of another version are not reused


@dataclass(frozen=True)
class DrivenEpisodes(EpisodesJob):
    """The episodes of an experiment, audited while they are driven; rows of an evaluation with the faults."""

    @property
    def identity(self) -> Row:
        """The fields that all rows share."""
        return {**super().identity, "checks": CHECKS}

    def run(self, tick: Tick) -> Result:
        """Drive and audit."""
        audit = Audit(self.experiment.config)
        rows = run(self.experiment, [self.ticking(tick), audit])
        shared = {"checks": CHECKS, "differs_at": None}
        return Result([row | shared | found for row, found in zip(rows, audit.rows(), strict=True)])


@dataclass(frozen=True)
class RecordedEpisode(Job):
    """A recorded episode of `steps` steps, one row per world."""

    path: Path
    steps: int

    titled = "{path}"

    @property
    def size(self) -> float:
        """Its steps."""
        return self.steps

    @property
    def files(self) -> tuple[str, ...]:
        """The episode."""
        return (str(self.path),)

    def run(self, tick: Tick) -> Result:
        """Play the episode again, audit it, and compare it with the recorded poses."""
        episode = Episode.load(whereabouts(str(self.path)))
        config, audit = episode.config, Audit(episode.config)
        differs: dict[int, int] = {}  # world: the first step whose poses are others
        for step, simulator in enumerate(episode.replay()):
            audit(simulator, step)
            same = simulator.state.pose.view(np.uint32) == episode.pose[step].astype(np.float32).view(np.uint32)
            for world in np.flatnonzero(~same.all(axis=(1, 2))).tolist():
                differs.setdefault(world, step)
            if step % TICK == 0:
                tick(step)
        shared = {
            "policy": episode.policy, "layout": episode.grid.name, "robots": config.num_agents, "tasks": config.tasks,
            "planner": config.planner, "episode": self.path,
        }  # fmt: skip
        return Result([
            {**shared, "seed": seed, "differs_at": differs.get(world), **found, "config": config.to_dict(),
             "checks": CHECKS, "version": __version__}
            for world, (seed, found) in enumerate(zip(episode.seeds, audit.rows(), strict=True))
        ])  # fmt: skip
