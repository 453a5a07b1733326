"""Provide small live worlds and read their messages."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import Any

from train.live.world import World, WorldSetting, live_floors

SETTING = WorldSetting("greedy", "open", 4, 7, "astar_turns")


def world(**changes: Any) -> World:
    """Return a world of four robots with right of way on the open floor, with changes."""
    setting = WorldSetting(**{**SETTING.__dict__, **changes})
    return World(setting, live_floors(setting.floor))


def messages(stream: bytes) -> Iterator[tuple[dict[str, Any], bytes]]:
    """Yield header and arrays of each message of a stream; all messages must be whole."""
    while stream:
        (size,) = struct.unpack_from("<I", stream)
        message, stream = stream[4 : 4 + size], stream[4 + size :]
        assert len(message) == size
        if size:
            (length,) = struct.unpack_from("<I", message)
            yield json.loads(message[4 : 4 + length]), message[4 + length :]


def bits(one: World) -> bytes:
    """Return all poses."""
    return one.simulator.state.pose.tobytes()
