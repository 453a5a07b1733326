"""Solve an instance with the planner of car-like robots (train/central/car_like)."""

from __future__ import annotations

import time
from functools import lru_cache

import numpy as np

from train.central.car_like.floor import floor_of
from train.central.car_like.together import Pose, Together, plan_together
from train.clmapf.instance import BODY, DISC_RADIUS, Instance, Poses, least_gap

_MARGIN = 0.01  # between bodies and to discs, less if the given poses are nearer


def solve(instance: Instance, seed: int, whole: bool = False) -> tuple[Together, float]:
    """Plan routes for all robots; return them and the processor time [s], without compiling.

    whole: keep whole bodies on the floor.
    """
    _warm_up()
    begun = time.process_time()
    margin = min(_MARGIN, 0.5 * least_gap(instance))
    floor = floor_of(instance.width, instance.height, instance.discs, DISC_RADIUS, BODY, margin, whole)
    found = plan_together(_tuples(instance.starts), _tuples(instance.goals), floor, seed)
    return found, time.process_time() - begun


def _tuples(poses: Poses) -> list[Pose]:
    return [(float(x), float(y), float(heading)) for x, y, heading in poses]


@lru_cache(maxsize=1)
def _warm_up() -> None:
    """Load or compile the kernels, with three robots of which two meet."""
    starts = [(5.0, 10.0, 0.0), (25.0, 10.0, np.pi), (5.0, 5.0, 0.0)]
    goals = [(25.0, 10.0, 0.0), (5.0, 10.0, np.pi), (8.0, 5.0, 0.5)]
    plan_together(starts, goals, floor_of(30.0, 20.0, np.array([[15.0, 2.0]]), DISC_RADIUS, BODY, _MARGIN), 0)
