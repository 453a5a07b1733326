"""Two pages of one frame, style and scripts in page/: replays as one file without a server, and a live simulation.

replay_codec.py packs a replay's arrays. So that one of a thousand robots opens at once, it is reduced to the moments
and way-points that a page needs. train/live/ serves the live page and sends its data.
"""

import base64
import dataclasses
import hashlib
import html
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, counted
from warehouse_env.files import write_text
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.chart_style import hexed
from warehouse_env.render.colours import CONTACT, WAITING, robot_colour
from warehouse_env.render.replay import FLAGS, REWARD_TERMS, Replay, simplified
from warehouse_env.render.replay_codec import packed
from warehouse_env.simulation.state import PERSON_RADIUS
from warehouse_env.traffic_spec import written_traffic

PAGE = Path(__file__).parent / "page"
# in the order in which the browser reads them; each page's own scripts follow
SHARED = (
    "data", "episode", "events", "sensors", "view", "floor", "robots", "people", "overlays", "stage", "charts",
    "preferences", "panel", "controls", "app", "build",
)  # fmt: skip
_PLACE = re.compile(r"\{\{(\w+)\}\}")
MANY = 32  # robots from which goals and trails are hidden at first, so that the floor stays visible


def scripts_of(folder: str, names: Iterable[str]) -> str:
    """Return the shared scripts and those of a page's folder as one."""
    files = [*(f"{name}.js" for name in SHARED), *(f"{folder}/{name}.js" for name in names)]
    text = "\n".join((PAGE / file).read_text(encoding="utf-8") for file in files)
    return f'(() => {{\n"use strict";\n{text}\n}})();'


def style_of(folder: str | None = None) -> str:
    """Return the shared style, followed by that of a page's folder."""
    files = ["page.css"] if folder is None else ["page.css", f"{folder}/page.css"]
    return "\n".join((PAGE / file).read_text(encoding="utf-8") for file in files)


def assembled(folder: str, parts: Mapping[str, str]) -> str:
    """Return a page: the shared frame, filled with the pieces in a page's folder and these parts."""
    pieces = {path.stem: path.read_text(encoding="utf-8") for path in (PAGE / folder).glob("*.html")}
    text = (PAGE / "page.html").read_text(encoding="utf-8")
    text = _PLACE.sub(lambda found: pieces.get(found[1], found[0]).rstrip("\n"), text)
    return _PLACE.sub(lambda found: parts[found[1]], text)


def as_json(value: Any) -> str:
    """Return JSON that is safe inside a script element."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def about_page(robots: int) -> dict[str, Any]:
    """Return a page's data for this number of robots, in JSON types: names of flags and terms, colours, layers."""
    few = robots < MANY
    return {
        "flags": FLAGS, "terms": REWARD_TERMS,
        "colours": {
            "robots": [hexed(robot_colour(i)) for i in range(robots)], "contact": hexed(CONTACT),
            "waiting": hexed(WAITING),
        },
        "layers": {"routes": True, "goals": few, "trails": few, "lidar": True, "waiting": True, "numbers": True},
    }  # fmt: skip


def about_world(name: str, grid: GridMap, config: EnvConfig, seed: int) -> dict[str, Any]:
    """Return a page's data about a world beside its arrays, in JSON types."""
    robots, traffic = config.num_agents, written_traffic(config.traffic_spec)
    rows, across = grid.shape
    discrete = config.action_type == "discrete"
    return {
        "name": name, "about": f"{grid.name}, {counted(robots, 'robot')}, traffic {traffic}, seed {seed}",
        "robots": robots, "gridRows": rows, "gridColumns": across, "cell": grid.cell_size, "discs": grid.discs.tolist(),
        "bodies": [
            {"length": body.length, "width": body.width, "wheelbase": body.wheelbase, "front": body.front_overhang}
            for body in config.kinds
        ],
        "kinds": config.kind_of,
        "idle": "parked" if config.tasks == "one_shot" else "says nothing",  # a robot of a real fleet
        "people": config.people, "personRadius": PERSON_RADIUS,
        "lidar": {"rays": config.sensor.rays, "range": config.sensor.lidar_range},
        "levels": config.speed_levels if discrete else [],
        "offsets": config.lateral_offsets if discrete else [],
    }  # fmt: skip


REPLAY = "replay"
REPLAY_SCRIPTS = ("timeline", "player", "main")
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
        "title": html.escape(title), "policy": _POLICY, "near": f"{replays[0].config.near_miss_gap:g}",
        "style": style_of(), "script": scripts_of(REPLAY, REPLAY_SCRIPTS),
        "about": as_json(about_page(most) | {"replays": [*map(_about, replays, columns)]}),
        "data": "\n".join(
            f'<script type="text/plain" class="data">{base64.b64encode(one).decode()}</script>' for one in data
        ),
    }  # fmt: skip
    write_text(path, assembled(REPLAY, parts))


def _about(replay: Replay, columns: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what the page says of a replay beside the packed arrays, in JSON types."""
    return about_world(replay.name, replay.grid, replay.config, replay.seed) | {
        "frames": len(replay.pose), "seconds": replay.seconds, "every": replay.every, "packed": columns,
    }  # fmt: skip


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


LIVE = "live"
LIVE_SCRIPTS = ("stream", "moments", "live_app", "fleet", "steer", "main")


class LivePage(NamedTuple):
    """A page, and its policy: a browser may run its one script, apply its one style, and talk to its own server."""

    text: str
    policy: str


def live_page(title: str, near_miss_gap: float, about: dict[str, Any]) -> LivePage:
    """Return the page; near_miss_gap [m] for its legend; about: the contents of its menus, in JSON types."""
    script, style = f"\n{scripts_of(LIVE, LIVE_SCRIPTS)}\n", f"\n{style_of(LIVE)}\n"
    policy = (
        f"default-src 'none'; script-src {_hashed(script)}; style-src {_hashed(style)}; img-src data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'"
    )
    parts = {
        "title": html.escape(title), "policy": policy, "near": f"{near_miss_gap:g}", "style": style[1:-1],
        "about": as_json(about), "data": "", "script": script[1:-1],
    }  # fmt: skip
    return LivePage(assembled(LIVE, parts), f"{policy}; frame-ancestors 'none'")


def _hashed(text: str) -> str:
    """Return the source that allows one script or style, by its content, in a content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
