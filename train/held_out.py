"""How the policy of a training drives on seeds that neither a training uses nor an evaluation: is it getting better?"""

from __future__ import annotations

from statistics import fmean

from train.evaluation.rollout import make_experiment, run
from train.learning.board import FIGURES
from train.learning.config import TrainingConfig

SEED = 900_000_000  # far above those of trainings and those that `warehouse evaluate` begins with
_FLOORS = 3  # the first ones of the training


def held_out(config: TrainingConfig) -> dict[str, float]:
    """Drive the policy in the folder of a training as it is meant to be driven; return the means of FIGURES.

    An episode on each of its first three floors, as long as those of the training, with the most robots that it has.
    """
    rows = []
    for number, floor in enumerate(config.layouts[:_FLOORS]):
        base = config.env(floor, max(config.robots))
        rows += run(make_experiment(str(config.directory), base, 1, config.episode_seconds, SEED + number))
    return {name: fmean(row[name] for row in rows) for name in FIGURES}
