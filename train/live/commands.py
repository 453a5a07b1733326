"""The commands of a page, as checked dataclasses; a wrong message is refused in one sentence."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import ClassVar

from warehouse_env.checked import Checked, check_names, from_plain
from warehouse_env.errors import ConfigError, shown, unknown_name

MOST_BYTES = 65_536  # of a message
MOST_ROBOTS = 256
SLOWEST, FASTEST = 0.25, 1000.0  # simulated seconds a second


@dataclass(frozen=True)
class Play(Checked):
    """Play or pause."""

    playing: bool


@dataclass(frozen=True)
class Speed(Checked):
    """Set the pace: simulated seconds a second; None: as fast as possible."""

    speed: float | None
    ranges: ClassVar = {"speed": (SLOWEST, FASTEST)}


@dataclass(frozen=True)
class Step(Checked):
    """Pause, after one more decision of the robots."""


@dataclass(frozen=True)
class Make(Checked):
    """Restart with another policy, floor, number of robots or seed."""

    policy: str | None = None
    floor: str | None = None
    robots: int | None = None
    seed: int | None = None
    ranges: ClassVar = {"robots": (1, MOST_ROBOTS), "seed": (0, 2**53)}  # whole numbers of a page


Command = Play | Speed | Step | Make
COMMANDS: dict[str, type[Command]] = {"play": Play, "speed": Speed, "step": Step, "make": Make}


def read_command(message: bytes) -> Command:
    """Return the command of a message such as {"do": "play", "playing": true}; ConfigError if it is wrong."""
    if len(message) > MOST_BYTES:
        raise ConfigError(f"a message has at most {MOST_BYTES:,} bytes, not {len(message):,}")
    try:
        data = json.loads(message)
    except (ValueError, RecursionError):  # no UTF-8, no JSON, or brackets without end
        raise ConfigError("a message must be a JSON object") from None
    if not isinstance(data, dict) or not isinstance(data.get("do"), str):
        raise ConfigError(f'a message must be a JSON object that says what to "do", not {shown(data)}')
    name = data.pop("do")
    if name not in COMMANDS:
        raise unknown_name("command", name, COMMANDS)
    kind = COMMANDS[name]
    check_names(f"{name} parameter", data, kind)
    return from_plain(kind, data)
