"""What pages may ask for: each message is a command, or one sentence says why not."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from train.live.commands import COMMANDS, MOST_BYTES, Leave, Make, Person, Play, Shelves, Speed, Step, read_command
from warehouse_env.errors import ConfigError


@pytest.mark.parametrize(
    ("message", "command"),
    [
        ({"do": "play", "playing": False}, Play(False)),
        ({"do": "speed", "speed": 4}, Speed(4.0)),
        ({"do": "speed", "speed": None}, Speed(None)),
        ({"do": "step"}, Step()),
        ({"do": "make", "robots": 12, "seed": 0}, Make(robots=12, seed=0)),
        ({"do": "shelves", "cells": [[1, 2], [3, 4]], "stand": True}, Shelves(((1, 2), (3, 4)), True)),
        ({"do": "person", "cell": [5, 6]}, Person((5, 6))),
        ({"do": "leave", "person": 0}, Leave(0)),
    ],
)
def test_messages_are_commands(message: dict[str, object], command: object) -> None:
    assert read_command(json.dumps(message).encode()) == command


def test_every_command_is_tried_above() -> None:
    marks = test_messages_are_commands.pytestmark  # type: ignore[attr-defined]
    assert {message["do"] for message, _ in marks[0].args[1]} == set(COMMANDS)


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (b"", "must be a JSON object"),
        (b"\xff\xfe", "must be a JSON object"),
        (b"[" * 60_000, "must be a JSON object"),
        (b"[]", "what to"),
        (b'{"do": ["play"]}', "what to"),
        (b'{"playing": true}', "what to"),
        (b'{"do": "plai"}', "did you mean play"),
        (b'{"do": "__class__"}', "unknown command"),
        (b'{"do": "play"}', "lacks the entry 'playing'"),
        (b'{"do": "play", "playing": 1}', "True or False"),
        (b'{"do": "play", "playing": true, "also": 1}', "unknown play parameter"),
        (b'{"do": "speed", "speed": 0.1}', "from 0.25 to 1000"),
        (b'{"do": "speed", "speed": NaN}', "speed=nan"),
        (b'{"do": "speed", "speed": 1e999}', "speed=inf"),
        (b'{"do": "speed"}', "lacks"),
        (b'{"do": "make", "robots": 257}', "from 1 to 256"),
        (b'{"do": "make", "robots": 12.5}', "whole number"),
        (b'{"do": "make", "seed": -1}', "from 0"),
        (b'{"do": "make", "policy": 3}', "a text"),
        (b'{"do": "make", "map": "/etc/passwd"}', "unknown make parameter"),
        (b'{"do": "shelves", "cells": [], "stand": true}', "1 to 1024 cells"),
        (b'{"do": "shelves", "cells": [[1, 2, 3]], "stand": true}', "a row and a column"),
        (b'{"do": "shelves", "cells": [[1, true]], "stand": true}', "whole number"),
        (b'{"do": "shelves", "cells": [1, 2], "stand": true}', "whole number"),
        (b'{"do": "shelves", "cells": {"0": 1}, "stand": true}', "whole number"),
        (b'{"do": "person", "cell": []}', "a row and a column"),
        (b'{"do": "leave", "person": null}', "whole number"),
        (b'{"do": "step"' + b" " * MOST_BYTES + b"}", "at most 65,536 bytes"),
    ],
)
def test_what_is_no_command_is_told_in_one_sentence(message: bytes, why: str) -> None:
    with pytest.raises(ConfigError) as refused:
        read_command(message)
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 300


def test_too_many_cells_are_refused() -> None:
    message = {"do": "shelves", "cells": [[1, 1]] * 1025, "stand": True}
    with pytest.raises(ConfigError, match="1 to 1024 cells"):
        read_command(json.dumps(message).encode())


_plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@given(
    st.sampled_from(sorted(COMMANDS)),
    st.dictionaries(
        st.sampled_from(["playing", "speed", "policy", "floor", "robots", "seed", "cells", "stand", "cell", "person"]),
        _plain,
        max_size=3,
    ),
)
def test_whatever_comes_is_a_command_or_refused(name: str, fields: dict[str, object]) -> None:
    said = ""
    try:
        command = read_command(json.dumps({"do": name, **fields}).encode())
    except ConfigError as error:
        said = str(error)
    assert "\n" not in said
    assert said or type(command) is COMMANDS[name]
