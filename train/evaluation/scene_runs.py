"""Scenes played side by side, one world a seed -> one row a seed: did all robots arrive in time?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from train.books import simulator_of
from train.evaluation.jobs import Job, Result, Tick
from train.evaluation.rollout import Experiment, Watcher, config_of, play_out
from train.evaluation.scenes import SCENES
from train.reporting.report import Table, grouped, number
from train.reporting.rows import Row, plain, wilson_interval
from warehouse_env import __version__
from warehouse_env.config import EnvConfig

WORLDS = 200  # side by side
_FIGURES = (
    "makespan_s", "collisions_robot", "collisions_shelf", "collisions_person", "longest_standing_s", "deadlocks",
    "longest_deadlock_s", "deadlock_log",
)  # fmt: skip
NOTE = (
    "resolved: all robots arrived within the time [95% interval by Wilson's score]; seconds: until the last one "
    "arrived, mean over the resolved ones; collisions and deadlocks: means over all seeds."
)


@dataclass(frozen=True)
class SceneJob(Job):
    """A scene of SCENES to be played once a seed, for at most `seconds`."""

    scene: str
    policy: str
    base: EnvConfig
    seconds: float
    seeds: range
    chosen: Mapping[str, Any] = field(default_factory=dict)  # see rollout.config_of

    @property
    def title(self) -> str:
        """What the progress bar says."""
        return f"{self.scene} · {self.policy}"

    @property
    def size(self) -> float:
        """The number of seeds."""
        return len(self.seeds)

    def run(self, tick: Tick, watch: Sequence[Watcher] = ()) -> Result:
        """Play; a row does not depend on the other seeds. watch: called with each Simulator."""
        scene = SCENES[self.scene]()
        config = config_of(self.policy, self.base.replace(num_agents=scene.robots, tasks="one_shot"), self.chosen)
        steps = max(1, round(self.seconds / (config.time_step * config.action_repeat)))
        config = config.replace(max_steps=steps)
        shared = {"scene": self.scene, "policy": self.policy, "robots": scene.robots, "planner": config.planner}
        about = {"config": config.to_dict(), "version": __version__}
        rows: list[Row] = []
        for first in range(0, len(self.seeds), WORLDS):
            seeds = self.seeds[first : first + WORLDS]
            simulator = simulator_of(config, len(seeds), scene.grid)
            simulator.reset_to([scene.draw(np.random.default_rng([seed, 2])) for seed in seeds], list(seeds))
            played, _ = play_out(Experiment(self.policy, config, seeds[0], tuple(range(len(seeds)))), simulator, watch)
            for seed, metrics in zip(seeds, played, strict=True):
                arrived = {"resolved": metrics["success_rate"] == 1.0, "arrived": round(metrics["goals"])}
                figures = {name: metrics[name] for name in _FIGURES}
                rows.append(plain({**shared, "seed": seed, **arrived, **figures, **about}))
            tick(len(rows))
        return Result(rows)


def scene_table(rows: Sequence[Row]) -> Table:
    """Return one line for each scene and policy."""
    header = ("scene", "robots", "policy", "seeds", "resolved %", "seconds", "collisions", "deadlocks")
    cells = []
    for (name, robots, policy), group in grouped(rows, ("scene", "robots", "policy")).items():
        resolved = [row for row in group if row["resolved"]]
        share, low, high, _ = wilson_interval(len(resolved), len(group))
        kinds = ("collisions_robot", "collisions_shelf", "collisions_person")
        mean = [float(np.mean([row.get(kind, 0.0) for row in group])) for kind in kinds]
        seconds = float(np.mean([row["makespan_s"] for row in resolved])) if resolved else float("nan")
        deadlocks = float(np.mean([row["deadlocks"] for row in group]))
        cells.append((
            str(name), str(robots), str(policy), str(len(group)),
            f"{100 * share:.1f} [{100 * low:.1f}, {100 * high:.1f}]", number(seconds), number(sum(mean)),
            number(deadlocks),
        ))  # fmt: skip
    return Table("Scenes", header, tuple(cells), NOTE)
