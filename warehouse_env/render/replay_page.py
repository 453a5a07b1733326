"""Replays as one HTML file that shows them in any browser, without a server or a network.

The page's text, style and scripts lie in page/; the arrays are packed by replay_codec.py.
"""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from warehouse_env.errors import ConfigError
from warehouse_env.files import complete_file
from warehouse_env.render.chart_style import hexed
from warehouse_env.render.colours import CONTACT, WAITING, robot_colour
from warehouse_env.render.replay import FLAGS, REWARD_TERMS, Replay
from warehouse_env.render.replay_codec import packed
from warehouse_env.render.thinning import thinned
from warehouse_env.simulation.state import PERSON_RADIUS

_PAGE = Path(__file__).parent / "page"
# in the order in which the browser reads them
_SCRIPTS = (
    "data", "episode", "events", "sensors", "view", "floor", "robots", "people", "overlays", "stage", "charts",
    "preferences", "panel", "timeline", "controls", "app", "main",
)  # fmt: skip
MANY = 32  # robots from which names and goals are left out at first, so that the floor is seen


def write_replay_page(path: Path, replays: Sequence[Replay], title: str, robot: int | None = None) -> None:
    """Write a page of one replay, or of two side by side and in step, all of it or nothing.

    robot: the one that is chosen at first. A link may say where to begin: page.html#t=12.5&robot=3&play, t in seconds.
    Raises ConfigError for another number of replays, WarehouseError where the file cannot be written.
    """
    if not 1 <= len(replays) <= 2:
        raise ConfigError(f"a page shows one replay, or two side by side, not {len(replays)}")
    replays = [thinned(replay) for replay in replays]
    columns, data = zip(*map(packed, replays), strict=True)
    scripts = "\n".join((_PAGE / f"{name}.js").read_text(encoding="utf-8") for name in _SCRIPTS)
    parts = {
        "title": html.escape(title),
        "near": f"{replays[0].config.near_miss_gap:g}",
        "style": (_PAGE / "replay.css").read_text(encoding="utf-8"),
        "about": _json(_about(replays, columns) | {"robot": robot}),
        "data": "\n".join(
            f'<script type="text/plain" class="data">{base64.b64encode(one).decode()}</script>' for one in data
        ),
        "script": f'(() => {{\n"use strict";\n{scripts}\n}})();',
    }
    template = (_PAGE / "replay.html").read_text(encoding="utf-8")
    page = re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)
    with complete_file(path) as part:
        part.write_text(page, encoding="utf-8")


def _json(value: Any) -> str:
    """Return JSON that may stand within a script element."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _about(replays: Sequence[Replay], columns: Sequence[list[dict[str, Any]]]) -> dict[str, Any]:
    """Return all that the page must know beside the packed arrays, in JSON types."""
    most = max(replay.pose.shape[1] for replay in replays)
    few = most < MANY
    return {
        "flags": FLAGS,
        "terms": REWARD_TERMS,
        "colours": {
            "robots": [hexed(robot_colour(i)) for i in range(most)],
            "contact": hexed(CONTACT),
            "waiting": hexed(WAITING),
        },
        "layers": {"routes": True, "goals": few, "trails": few, "lidar": True, "waiting": True, "numbers": True},
        "replays": [_about_one(replay, packed) for replay, packed in zip(replays, columns, strict=True)],
    }


def _about_one(replay: Replay, columns: list[dict[str, Any]]) -> dict[str, Any]:
    config, body = replay.config, replay.config.robot
    frames, robots = replay.pose.shape[:2]
    rows, across = replay.grid.shape
    discrete = config.action_type == "discrete"
    return {
        "name": replay.name,
        "about": f"{replay.grid.name}, {robots} robot{'s' * (robots != 1)}, seed {replay.seed}",
        "frames": frames,
        "robots": robots,
        "seconds": replay.seconds,
        "every": replay.every,
        "gridRows": rows,
        "gridColumns": across,
        "cell": replay.grid.cell_size,
        "body": {
            "length": body.length, "width": body.width, "wheelbase": body.wheelbase, "front": body.front_overhang,
        },
        "people": replay.people.shape[1],
        "personRadius": PERSON_RADIUS,
        "lidar": {"rays": config.sensor.rays, "range": config.sensor.lidar_range},
        "levels": config.speed_levels if discrete else [],
        "offsets": config.lateral_offsets if discrete else [],
        "packed": columns,
    }  # fmt: skip
