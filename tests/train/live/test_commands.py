"""Each message of a page is a command, or is refused in one sentence."""

from __future__ import annotations

import json

import pytest

from train.live.commands import MOST_BYTES, Make, Play, Speed, Step, read_command
from warehouse_env.errors import ConfigError


@pytest.mark.parametrize(
    ("message", "command"),
    [
        ({"do": "play", "playing": False}, Play(False)),
        ({"do": "speed", "speed": 4}, Speed(4.0)),
        ({"do": "speed", "speed": None}, Speed(None)),
        ({"do": "step"}, Step()),
        ({"do": "make", "robots": 12, "seed": 0}, Make(robots=12, seed=0)),
    ],
)
def test_messages_are_commands(message: dict[str, object], command: object) -> None:
    assert read_command(json.dumps(message).encode()) == command


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (b"", "must be a JSON object"),
        (b'{"do": "plai"}', "did you mean play"),
        (b'{"do": "play"}', "lacks the entry 'playing'"),
        (b'{"do": "play", "playing": true, "also": 1}', "unknown play parameter"),
        (b'{"do": "speed", "speed": 0.1}', "from 0.25 to 1000"),
        (b'{"do": "make", "map": "/etc/passwd"}', "unknown make parameter"),
        (b'{"do": "step"' + b" " * MOST_BYTES + b"}", "at most 65,536 bytes"),
    ],
)
def test_what_is_no_command_is_told_in_one_sentence(message: bytes, why: str) -> None:
    with pytest.raises(ConfigError) as refused:
        read_command(message)
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 300
