"""The page that shows and steers a running simulation, from page/ and page/live/, and its content security policy.

train/live/ serves it and sends its data.
"""

from __future__ import annotations

import base64
import hashlib
import html
from typing import Any, NamedTuple

from warehouse_env.render.page_text import as_json, assembled, scripts_of, style_of

FOLDER = "live"
SCRIPTS = ("stream", "moments", "live_app", "fleet", "steer", "main")


class LivePage(NamedTuple):
    """A page, and its policy: a browser may run its one script, apply its one style, and talk to its own server."""

    text: str
    policy: str


def live_page(title: str, near_miss_gap: float, about: dict[str, Any]) -> LivePage:
    """Return the page; near_miss_gap [m] for its legend; about: the contents of its menus, in JSON types."""
    script, style = f"\n{scripts_of(FOLDER, SCRIPTS)}\n", f"\n{style_of(FOLDER)}\n"
    policy = (
        f"default-src 'none'; script-src {_hashed(script)}; style-src {_hashed(style)}; img-src data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'"
    )
    parts = {
        "title": html.escape(title),
        "policy": policy,
        "near": f"{near_miss_gap:g}",
        "style": style[1:-1],
        "about": as_json(about),
        "data": "",
        "script": script[1:-1],
    }
    return LivePage(assembled(FOLDER, parts), f"{policy}; frame-ancestors 'none'")


def _hashed(text: str) -> str:
    """Return the source that allows one script or style, by its content, in a content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
