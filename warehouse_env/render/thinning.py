"""Reduce a replay to the moments and way-points that a page needs, so that one of a thousand robots opens at once.

Events between two kept moments move to the second one; rewards are summed.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from warehouse_env.render.lines import simplified
from warehouse_env.render.replay import FLAGS, Replay

MOST = 1_600_000  # robots times moments: 256 robots for ten minutes at every step of 0.1 s, 1,024 at every fourth
NEAR = 0.05  # [m] that a route's line may lie beside the planned one
_HAPPENED = sum(1 << FLAGS.index(name) for name in ("arrived", "hit_robot", "hit_shelf", "near_miss", "hit_person"))


def thinned(replay: Replay, most: int = MOST) -> Replay:
    """Return a replay of at most `most` robots times moments after the first, with the visible way-points."""
    steps, robots = len(replay.pose) - 1, replay.pose.shape[1]
    routes = tuple(simplified(line, NEAR) for line in replay.routes)
    every = math.ceil(steps * robots / most)
    return dataclasses.replace(_every(replay, every) if every > 1 else replay, routes=routes)


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
