"""Replays as one HTML file that shows them in any browser, without a server or a network.

The page's text, style and scripts lie in page/ and page/replay/; the arrays are packed by replay_codec.py. So that one
of a thousand robots opens at once, a replay is reduced to the moments and way-points that a page needs.
"""

from __future__ import annotations

import base64
import dataclasses
import html
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from warehouse_env.errors import ConfigError
from warehouse_env.files import write_text
from warehouse_env.render.lines import simplified
from warehouse_env.render.page_text import about_page, about_world, as_json, assembled, scripts_of, style_of
from warehouse_env.render.replay import FLAGS, Replay
from warehouse_env.render.replay_codec import packed

FOLDER = "replay"
SCRIPTS = ("timeline", "player", "main")
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
MOST = 1_600_000  # robots times moments: 256 robots for ten minutes at every step of 0.1 s, 1,024 at every fourth
NEAR = 0.05  # [m] that a route's line may lie beside the planned one
_HAPPENED = sum(1 << FLAGS.index(name) for name in ("arrived", "hit_robot", "hit_shelf", "near_miss", "hit_person"))


def write_replay_page(path: Path, replays: Sequence[Replay], title: str) -> None:
    """Write a page of one replay, or of two side by side and in step, all of it or nothing.

    A link may say where to begin: page.html#t=12.5&robot=3&play, t in seconds.
    Raises ConfigError for another number of replays, WarehouseError if the file cannot be written.
    """
    if not 1 <= len(replays) <= 2:
        raise ConfigError(f"a page shows one replay, or two side by side, not {len(replays)}")
    replays = [thinned(replay) for replay in replays]
    columns, data = zip(*map(packed, replays), strict=True)
    most = max(replay.pose.shape[1] for replay in replays)
    parts = {
        "title": html.escape(title),
        "policy": _POLICY,
        "near": f"{replays[0].config.near_miss_gap:g}",
        "style": style_of(),
        "about": as_json(about_page(most) | {"replays": [*map(_about, replays, columns)]}),
        "data": "\n".join(
            f'<script type="text/plain" class="data">{base64.b64encode(one).decode()}</script>' for one in data
        ),
        "script": scripts_of(FOLDER, SCRIPTS),
    }
    page = assembled(FOLDER, parts)
    write_text(path, page)


def _about(replay: Replay, columns: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what the page says of a replay beside the packed arrays, in JSON types."""
    return about_world(replay.name, replay.grid, replay.config, replay.seed) | {
        "frames": len(replay.pose),
        "seconds": replay.seconds,
        "every": replay.every,
        "packed": columns,
    }


def thinned(replay: Replay, most: int = MOST) -> Replay:
    """Return a replay of at most `most` robots times moments after the first, with the visible way-points."""
    steps, robots = len(replay.pose) - 1, replay.pose.shape[1]
    routes = tuple(simplified(line, NEAR) for line in replay.routes)
    every = math.ceil(steps * robots / most)
    return dataclasses.replace(_every(replay, every) if every > 1 else replay, routes=routes)


def _every(replay: Replay, every: int) -> Replay:
    """Return the first of a replay's moments and each `every`th from there on.

    Events between two kept moments move to the second one; rewards are summed.
    """
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
