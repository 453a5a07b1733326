"""Replays as one HTML file that shows them in any browser, without a server or a network.

The page's text, style and scripts lie in page/ and page/replay/; the arrays are packed by replay_codec.py.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from warehouse_env.errors import ConfigError
from warehouse_env.files import write_text
from warehouse_env.render.page_text import about_page, about_world, as_json, assembled, scripts_of, style_of
from warehouse_env.render.replay import Replay
from warehouse_env.render.replay_codec import packed
from warehouse_env.render.thinning import thinned

FOLDER = "replay"
SCRIPTS = ("timeline", "player", "main")
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"


def write_replay_page(path: Path, replays: Sequence[Replay], title: str) -> None:
    """Write a page of one replay, or of two side by side and in step, all of it or nothing.

    A link may say where to begin: page.html#t=12.5&robot=3&play, t in seconds.
    Raises ConfigError for another number of replays, WarehouseError if the file cannot be written.
    """
    if not 1 <= len(replays) <= 2:
        raise ConfigError(f"a page shows one replay, or two side by side, not {len(replays)}")
    replays = [thinned(replay) for replay in replays]
    columns, data = zip(*map(packed, replays), strict=True)
    parts = {
        "title": html.escape(title),
        "policy": _POLICY,
        "near": f"{replays[0].config.near_miss_gap:g}",
        "style": style_of(),
        "about": as_json(_about(replays, columns)),
        "data": "\n".join(
            f'<script type="text/plain" class="data">{base64.b64encode(one).decode()}</script>' for one in data
        ),
        "script": scripts_of(FOLDER, SCRIPTS),
    }
    page = assembled(FOLDER, parts)
    write_text(path, page)


def _about(replays: Sequence[Replay], columns: Sequence[list[dict[str, Any]]]) -> dict[str, Any]:
    """Return the page's data beside the packed arrays, in JSON types."""
    most = max(replay.pose.shape[1] for replay in replays)
    return about_page(most) | {
        "replays": [_about_one(replay, packed) for replay, packed in zip(replays, columns, strict=True)],
    }


def _about_one(replay: Replay, columns: list[dict[str, Any]]) -> dict[str, Any]:
    return about_world(replay.name, replay.grid, replay.config, replay.seed) | {
        "frames": len(replay.pose),
        "seconds": replay.seconds,
        "every": replay.every,
        "packed": columns,
    }
