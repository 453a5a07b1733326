"""Reduce a replay to the moments and way-points that a page needs, so that one of a thousand robots opens at once.

Events between two kept moments move to the second one; rewards are summed.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.render.lines import simplified
from warehouse_env.render.replay import FLAGS, Replay

MOST = 1_600_000  # robots times moments: 256 robots for ten minutes at every step of 0.1 s, 1,024 at every fourth
NEAR = 0.05  # [m] that a route's line may lie beside the planned one, as far as it was driven and AHEAD
AHEAD = 8.0  # [m]
_FAR = 260  # farther on it may lie beside by such a part of the floor's longer side
_HAPPENED = sum(1 << FLAGS.index(name) for name in ("arrived", "hit_robot", "hit_shelf", "near_miss", "hit_person"))


def thinned(replay: Replay, most: int = MOST) -> Replay:
    """Return a replay of at most `most` robots times moments after the first, with the visible way-points."""
    steps, robots = len(replay.pose) - 1, replay.pose.shape[1]
    every = math.ceil(steps * robots / most)
    return dataclasses.replace(_every(replay, every) if every > 1 else replay, routes=_lines(replay))


def _every(replay: Replay, every: int) -> Replay:
    """Return the first of a replay's moments and each `every`th from there on."""
    arrays: dict[str, Any] = {
        field.name: value[::every].copy()
        for field in dataclasses.fields(replay)
        if isinstance(value := getattr(replay, field.name), np.ndarray)
    }
    between, kept = slice(1, None), len(arrays["pose"]) - 1
    happened = (replay.flags & np.uint16(_HAPPENED))[between][: kept * every]
    arrays["flags"][1:] |= np.bitwise_or.reduce(happened.reshape(kept, every, *happened.shape[1:]), axis=1)
    terms = replay.rewards[between][: kept * every]
    arrays["rewards"][1:] = terms.reshape(kept, every, *terms.shape[1:]).sum(axis=1)
    return dataclasses.replace(replay, every=replay.every * every, **arrays)


def _lines(replay: Replay) -> tuple[NDArray[np.float32], ...]:
    """Return each route with fewer way-points: exact where it was driven, coarser elsewhere."""
    driven = np.zeros(len(replay.routes))
    np.maximum.at(driven, replay.route.reshape(-1), replay.along.reshape(-1))
    far = max(NEAR, max(replay.grid.shape) * replay.grid.cell_size / _FAR)
    return tuple(
        simplified(line, np.where(_along(line) <= reached + AHEAD, NEAR, far))
        for line, reached in zip(replay.routes, driven.tolist(), strict=True)
    )


def _along(line: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return float64[K], the length of a line up to each of its points [m]."""
    steps = np.hypot(*np.diff(line.astype(np.float64), axis=0, prepend=line[:1]).T)
    return np.cumsum(steps)
