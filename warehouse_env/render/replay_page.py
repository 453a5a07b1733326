"""Replays as one HTML file that shows them in any browser, without a server or a network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from warehouse_env.render.replay import Replay


def write_replay_page(path: Path, replays: Sequence[Replay], title: str) -> None:
    """Write a page of one replay, or of two side by side and in step, all of it or nothing.

    Raises ConfigError for another number of them, WarehouseError where it cannot be written.
    """
    raise NotImplementedError
