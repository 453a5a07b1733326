"""`warehouse robust`: policies in worlds that are not as they were trained in -> rows, one table of what holds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from train.commands.evaluate import Episodes
from train.evaluation.disturbances import DISTURBANCES, UNDISTURBED
from train.evaluation.robustness import robust_table
from warehouse_env.errors import unknown_name


@dataclass(frozen=True)
class Robust(Episodes):
    """Drive policies with other bodies, worse sensors, lost messages, a broken robot; print what holds and breaks."""

    policy: tuple[str, ...] = ("greedy", "reinforce", "ppo", "threaded_ppo")
    """Policies to compare: names, or folders of trained ones."""
    layout: tuple[str, ...] = ("paper46", "narrow")
    """Layouts to drive on."""
    robots: tuple[int, ...] = (16, 32)
    """Numbers of robots."""
    disturbance: tuple[str, ...] = tuple(DISTURBANCES)
    """What to disturb; each is held against the undisturbed world, which is driven in any case."""
    episodes: int = 3
    """Episodes of each disturbance, policy, floor and number of robots; all have the same seeds."""
    seconds: float = 300.0
    """Simulated time of an episode [s]."""
    out: Path = Path("results/robust")
    """Folder for the rows and the table."""

    def run(self) -> None:
        """Play everything, print the table, write rows and table."""
        for name in self.disturbance:
            if name not in DISTURBANCES:
                raise unknown_name("disturbance", name, DISTURBANCES)
        names = dict.fromkeys((UNDISTURBED, *self.disturbance))
        self.tabulate([experiment for name in names for experiment in self.experiments(name)], robust_table)
        print(f"wrote the rows to {self.rows_path}, the table to {self.out}")
