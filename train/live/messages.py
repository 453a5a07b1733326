"""Messages to pages: a header as JSON and arrays as in replay_codec.py, each message preceded by its length.

Little-endian: uint32 bytes of the rest, uint32 bytes of the header, the header, the arrays. The header's `kind` is
`world` (everything that a page needs to begin), `moments` (which continue it) or `note` (the pace, and what is being
made). A message of length 0 only keeps the connection alive.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.live.figures import Sample
from train.live.world import Moment, World
from warehouse_env.render.page_text import about_world
from warehouse_env.render.replay import Replay
from warehouse_env.render.replay_codec import Column, floor_columns, laid_out, moment_columns, route_columns

ALIVE = struct.pack("<I", 0)
Routes = Mapping[int, NDArray[np.float32]]


def note(told: Mapping[str, Any]) -> bytes:
    """Return a message without arrays."""
    return _message({"kind": "note", **told}, ())


def whole(world: World, first: int, moment: Moment, routes: Routes, samples: Iterable[Sample]) -> bytes:
    """Return the message of a world at moment number `first`, with the robots' routes."""
    setting = world.setting
    about = about_world(setting.policy, world.grid, world.simulator.config, setting.seed)
    header = {
        "kind": "world", **about, "world": world.made, "floor": setting.floor, "policy": setting.policy,
        "seed": setting.seed, "seconds": world.step_seconds, "begin": world.seconds,
        **_moments(first, 1, routes, samples),
    }  # fmt: skip
    return _message(header, [*floor_columns(world.grid), *_columns(world, [moment], routes)])


def further(world: World, first: int, moments: Sequence[Moment], routes: Routes, samples: Iterable[Sample]) -> bytes:
    """Return the message of the moments from number `first` on, with routes that are new in them."""
    header = {"kind": "moments", **_moments(first, len(moments), routes, samples)}
    return _message(header, _columns(world, moments, routes))


def _moments(first: int, count: int, routes: Routes, samples: Iterable[Sample]) -> dict[str, Any]:
    return {"first": first, "count": count, "routes": list(routes), "samples": list(samples)}


def _columns(world: World, moments: Sequence[Moment], routes: Routes) -> list[Column]:
    arrays: dict[str, Any] = {name: np.stack([moment[name] for moment in moments]) for name in moments[0]}
    replay = Replay("", world.grid, world.simulator.config, world.setting.seed, routes=(), **arrays)
    return [*moment_columns(replay), *route_columns(list(routes.values()), world.grid)]


def _message(header: dict[str, Any], columns: Iterable[Column]) -> bytes:
    about, data = laid_out(columns)
    text = json.dumps({**header, "columns": about}, allow_nan=False, separators=(",", ":")).encode()
    return struct.pack("<II", 4 + len(text) + len(data), len(text)) + text + data
