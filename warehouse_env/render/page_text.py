"""Shared parts of the replay page and the live page: frame, style and scripts in page/, and their data."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from warehouse_env.config import EnvConfig
from warehouse_env.errors import counted
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.chart_style import hexed
from warehouse_env.render.colours import CONTACT, WAITING, robot_colour
from warehouse_env.render.replay import FLAGS, REWARD_TERMS
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
        "flags": FLAGS,
        "terms": REWARD_TERMS,
        "colours": {
            "robots": [hexed(robot_colour(i)) for i in range(robots)],
            "contact": hexed(CONTACT),
            "waiting": hexed(WAITING),
        },
        "layers": {"routes": True, "goals": few, "trails": few, "lidar": True, "waiting": True, "numbers": True},
    }


def about_world(name: str, grid: GridMap, config: EnvConfig, seed: int) -> dict[str, Any]:
    """Return a page's data about a world beside its arrays, in JSON types."""
    robots, traffic = config.num_agents, written_traffic(config.traffic_spec)
    rows, across = grid.shape
    discrete = config.action_type == "discrete"
    return {
        "name": name,
        "about": f"{grid.name}, {counted(robots, 'robot')}, traffic {traffic}, seed {seed}",
        "robots": robots,
        "gridRows": rows,
        "gridColumns": across,
        "cell": grid.cell_size,
        "discs": grid.discs.tolist(),
        "bodies": [
            {"length": body.length, "width": body.width, "wheelbase": body.wheelbase, "front": body.front_overhang}
            for body in config.kinds
        ],
        "kinds": config.kind_of,
        "idle": "parked" if config.tasks == "one_shot" else "says nothing",  # a robot of a real fleet
        "people": config.people,
        "personRadius": PERSON_RADIUS,
        "lidar": {"rays": config.sensor.rays, "range": config.sensor.lidar_range},
        "levels": config.speed_levels if discrete else [],
        "offsets": config.lateral_offsets if discrete else [],
    }  # fmt: skip
