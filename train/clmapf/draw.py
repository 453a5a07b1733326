"""Instances drawn like the benchmark's, to develop on: those of the benchmark itself are for reporting alone."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from train.clmapf.instance import Instance, Poses, disc_gap
from warehouse_env.errors import ConfigError

YAWS = (0.0, 1.57, 3.14, -1.57)
_SIDES, _APART = (50.0, 100.0, 300.0), (5.6, 7.8, 10.0)  # what starts, and goals, are apart in the benchmark's cells
_DISC_APART, _DISC_OFF = 1.0, 2.73  # discs from each other, and from axles
_TRIES = 2000  # of one pose or disc; then all begins anew
_STARTS = 20


def draw_instance(side: int, robots: int, discs: int, seed: int) -> Instance:
    """Return an instance on a square floor: whole poses, goals between a quarter and half of its side away.

    No disc overlaps a start or goal, as some of the benchmark's do.
    """
    random = np.random.default_rng([seed, side, robots, discs])
    for _ in range(_STARTS):
        starts = _draw(robots, lambda known: _pose(random, side, known, None))
        goals = None if starts is None else _draw(robots, lambda known, s=starts: _pose(random, side, known, s))  # type: ignore[misc]
        if starts is None or goals is None:
            continue
        poses = np.array(starts + goals)
        found = _draw(discs, lambda known, p=poses: _disc(random, side, known, p))  # type: ignore[misc]
        if found is not None:
            name = f"map{side}_discs{discs}_agents{robots:03d}_seed{seed}"
            names = tuple(f"agent{i}" for i in range(robots))
            kept = np.array(found).reshape(-1, 2)
            return Instance(name, float(side), float(side), names, np.array(starts), np.array(goals), kept)
    raise ConfigError(f"{robots} robots and {discs} obstacles find no room on a floor of {side} x {side}")


_Found = NDArray[np.float64]


def _draw(count: int, propose: Callable[[list[_Found]], _Found | None]) -> list[_Found] | None:
    """Return `count` things, each taken as soon as it is let; None where one never is."""
    known: list[_Found] = []
    for _ in range(count):
        found = next((one for _ in range(_TRIES) if (one := propose(known)) is not None), None)
        if found is None:
            return None
        known.append(found)
    return known


def _pose(random: np.random.Generator, side: int, known: list[_Found], starts: list[_Found] | None) -> _Found | None:
    x, y = random.integers(2, side - 1, 2).tolist()
    pose = np.array([x, y, -YAWS[random.integers(4)]])
    apart = np.interp(side, _SIDES, _APART)
    far = starts is None or 0.25 * side <= math.dist((x, y), starts[len(known)][:2]) <= 0.5 * side
    return pose if far and all(math.dist((x, y), other[:2]) > apart for other in known) else None


def _disc(random: np.random.Generator, side: int, known: list[_Found], poses: Poses) -> _Found | None:
    disc = np.round(random.uniform(0.0, side, 2), 4)
    near = any(math.dist(disc, pose[:2]) < _DISC_OFF or disc_gap(pose, disc) <= 0.0 for pose in poses)
    return None if near or any(math.dist(disc, other) < _DISC_APART for other in known) else disc
