"""Options of a training of a few seconds: small worlds on the open floor."""

from __future__ import annotations

from typing import Any

SMALL: dict[str, Any] = {
    "layouts": ("open",), "robots": (2, 4), "rows": 8, "planner": "astar", "rollout": 6, "minibatch": 24,
    "hidden": (24,), "episode_seconds": 3.0, "checkpoint_seconds": 0.0, "threads": 1, "progress": False,
}  # fmt: skip
