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
