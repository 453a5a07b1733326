"""Odd values for property tests, and what must come of them: it works, or one sentence says what is wrong."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.errors import MapWarning, WarehouseError

numbers = st.one_of(
    st.integers(-3, 40),
    st.floats(),
    st.sampled_from([10**9, 10**12, 2**63, -(2**70), 10**400, 1e-30, 1e30, -1e300, True]),
    st.sampled_from([np.float32(0.5), np.float64(np.nan), np.int8(3), np.uint64(2**64 - 1), np.bool_(True)]),
)
others = st.sampled_from(
    [None, "", "x", "\0", "\ud800", b"a", object(), {}, {"a": 1}, [], (), set(), 1j, np.zeros(2), np.zeros((2, 2)),
     np.array(1.0), np.array(["a"]), [[1]], [[0, 1], [1]], [(0, 0)], [[2**70, 0]], Path("p"), EnvConfig, SensorSpec(),
     "lifelong", "raw", range(3), np.zeros((0, 2), int), np.array([[0, 2**64 - 1]], np.uint64), np.array([object()])]
)  # fmt: skip
values = st.one_of(numbers, others, st.text(max_size=5), st.lists(numbers, max_size=4), st.lists(others, max_size=2))


def works_or_says(make: Callable[[], Any]) -> Any:
    """Return what `make` makes, or None where it raises a WarehouseError of one sentence; nothing else may happen."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", MapWarning)  # which says what robots of that size cannot reach
        try:
            return make()
        except WarehouseError as error:
            text = str(error)
            assert text
            assert "\n" not in text
            assert len(text) < 700
            return None


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """Draw a file's bytes with a few of them changed, cut out or put in."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(content)))
        cut = draw(st.sampled_from([0, 1, 8, len(content)]))
        pieces = [
            b"",
            b"9999999",
            b"\xff\xfe",
            b"null",
            b"NaN",
            b"1e999",
            b"[" * 3000,
            b"1" * 5000,
            b"\0",
            b"\r\n",
            b'"',
        ]
        piece = draw(st.one_of(st.binary(max_size=3), st.sampled_from(pieces)))
        content = content[:at] + piece + content[at + cut :]
    return content


@st.composite
def changed(draw: st.DrawFn, data: Any) -> Any:
    """Draw JSON data with one entry, at any depth, taken out or put in or of another value."""
    keys = list(data) if isinstance(data, dict) else list(range(len(data))) if isinstance(data, list) else []
    if not keys:
        return draw(st.sampled_from([None, -1, 0, 2.5, 1e30, float("inf"), 10**30, "x", "\0", [], {}, [[1]], True]))
    key = draw(st.sampled_from(keys))
    copy = data.copy()
    if isinstance(data, dict) and draw(st.integers(0, 5)) == 0:
        del copy[key]
        return copy
    copy[key] = draw(changed(data[key] if draw(st.booleans()) else None))
    return copy
