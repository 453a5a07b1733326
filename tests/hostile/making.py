"""Makes hostile inputs from a generator: odd values, damaged bytes, changed JSON, archives of changed arrays."""

from __future__ import annotations

import io
import json
import re
import zipfile
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.maps.grid_map import GridMap

NUMBERS: list[Any] = [
    0, 1, 2, -1, 3, 7, 40, 0.5, -0.0, 1e-320, 10**9, 10**12, 2**31, 2**63, 2**64, -(2**70), 10**400, 1e30, -1e300, True,
    float("nan"), float("inf"), -float("inf"), np.float32(0.5), np.float64(np.nan), np.int8(3), np.uint64(2**64 - 1),
    np.bool_(True), np.float16(1e4), np.longdouble(1),
]  # fmt: skip
OTHERS: list[Any] = [
    None, "", "x", "\0", "\ud800", "\u202e", "a" * 5000, "../..", "/", "/dev/null", "~", "a/b", ".", "é\n", b"a",
    object(), {}, {"a": 1}, {1: 2}, [], (), set(), 1j, np.zeros(2), np.zeros((2, 2)), np.array(1.0), np.array(["a"]),
    [[1]],
    [[0, 1], [1]], [(0, 0)], [[2**70, 0]], Path("p"), EnvConfig, EnvConfig(), SensorSpec(), "lifelong", "raw", range(3),
    np.zeros((0, 2), int), np.array([[0, 2**64 - 1]], np.uint64), np.array([object()]), np.datetime64("2020"),
    np.full((4, 2), 1e300), np.full((2, 2), 2**63, np.uint64), [1, [2]], [0, 1], lambda: 3,
    GridMap(np.zeros((3, 3))), bytearray(b"x"), memoryview(b"xy"), "open", "astar", "paper46:seed=1",
    "open:rows=99999999",
]  # fmt: skip
PLAIN: list[Any] = [
    None, True, False, 0, -1, 2, 2.5, 1e30, 10**30, float("inf"), float("nan"), "", "x", "\0", "\ud800", "raw", [], {},
    [[1]], {"a": None}, ["x"] * 40, [0.5, "a"], "../x", "é" * 300, -1e-320, 1 << 63,
]  # fmt: skip
PIECES = [
    b"", b"9999999", b"-1", b"\xff\xfe", b"\xef\xbb\xbf", b"null", b"NaN", b"1e999", b"[" * 3000, b'{"a":' * 2000,
    b"1" * 5000, b"\0", b"\r\n", b"\n", b"\t", b'"', b"\\ud800", "\u0663".encode(), b"0x10", b"1_000", b" ", b"@", b"v",
]  # fmt: skip


def value(rng: Random, depth: int = 2) -> Any:
    """Return any value at all."""
    kind = rng.random()
    if kind < 0.45:
        return rng.choice(NUMBERS)
    if kind < 0.75:
        return rng.choice(OTHERS)
    if kind < 0.85:
        return rng.choice([rng.randrange(-5, 50), rng.gauss(0, 1), rng.gauss(0, 1e6), rng.getrandbits(64)])
    if kind < 0.9 or not depth:
        return text(rng)
    several = [value(rng, depth - 1) for _ in range(rng.randrange(4))]
    return rng.choice([list, tuple])(several)


def text(rng: Random) -> str:
    """Return a few odd characters."""
    return "".join(chr(rng.choice([rng.randrange(128), rng.randrange(0x11000)])) for _ in range(rng.randrange(8)))


def options(rng: Random, names: list[str], most: int = 3) -> dict[str, Any]:
    """Return some of the names with any values."""
    return {rng.choice(names): value(rng) for _ in range(rng.randint(1, most))}


def damaged(rng: Random, content: bytes) -> bytes:
    """Return bytes with a few of them changed, cut out, doubled, put in or put elsewhere."""
    for _ in range(rng.randint(1, 4)):
        at, kind = rng.randint(0, len(content)), rng.randrange(7)
        end = min(len(content), at + rng.choice([1, 2, 8, 64, len(content)]))
        if kind == 0 and at < len(content):
            content = content[:at] + bytes([content[at] ^ 1 << rng.randrange(8)]) + content[at + 1 :]
        elif kind == 1:
            content = content[:at]
        elif kind == 2:
            content = content[:at] + content[end:]
        elif kind == 3 and len(content) < 10**6:
            content = content[:end] + content[at:]
        elif kind == 4:
            other = rng.randint(0, len(content))
            content = content[:at] + content[other : other + end - at] + content[end:]
        elif kind == 5:
            content = _other_number(rng, content)
        else:
            content = content[:at] + rng.choice([*PIECES, rng.randbytes(3)]) + content[at:]
    return content


def _other_number(rng: Random, content: bytes) -> bytes:
    """Return bytes in which one of the numbers is another."""
    found = list(re.finditer(rb"\d+", content[:100_000]))
    if not found:
        return content
    at = rng.choice(found)
    new = rng.choice(
        [b"0", b"-1", b"7", b"4294967296", b"9" * 30, b"1e400", b"nan", b"65536", str(rng.randrange(99)).encode()]
    )
    return content[: at.start()] + new + content[at.end() :]


def changed(rng: Random, data: Any) -> Any:
    """Return JSON data with an entry, at any depth, taken out, put in, or of another value."""
    keys = list(data) if isinstance(data, dict) else list(range(len(data))) if isinstance(data, list) else []
    if not keys:
        return rng.choice([*PLAIN, rng.gauss(0, 100), rng.randrange(1000)])
    key, copy, kind = rng.choice(keys), data.copy(), rng.random()
    if kind < 0.1:
        del copy[key]
    elif kind < 0.2 and isinstance(data, dict):
        copy[text(rng)] = copy.pop(key)
    else:
        copy[key] = changed(rng, data[key] if kind < 0.8 else None)
    return copy


def json_bytes(rng: Random, data: Any) -> bytes:
    """Return JSON that was changed, or whose text was damaged."""
    if rng.random() < 0.3:
        return damaged(rng, json.dumps(data).encode())
    for _ in range(rng.randint(1, 3)):
        data = changed(rng, data)
    return json.dumps(data).encode()


def json_lines(rng: Random, rows: list[Any]) -> bytes:
    """Return lines of which some were changed."""
    lines = [json_bytes(rng, row) if rng.random() < 0.4 else json.dumps(row).encode() for row in rows]
    return (damaged(rng, b"\n".join(lines)) if rng.random() < 0.2 else b"\n".join(lines)) + rng.choice([b"\n", b""])


def archive(rng: Random, members: dict[str, bytes]) -> bytes:
    """Return a zip file with right sums, in which a member was damaged, is missing, or is another one."""
    members = dict(members)
    name, kind = rng.choice(list(members)), rng.random()
    if kind < 0.1:
        del members[name]
    elif kind < 0.2:
        members[name] = rng.choice(list(members.values()))
    else:
        members[name] = damaged(rng, members[name])
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", rng.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])) as file:
        for name, data in members.items():
            file.writestr(zipfile.ZipInfo(name), data)
    return content.getvalue()
