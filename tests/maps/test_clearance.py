"""The gap between a segment and the shelves, against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warehouse_env.maps.clearance import segment_gap


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 10_000))
def test_gap_of_a_segment_against_many_points_of_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    occupied = rng.random((5, 6)) < 0.3
    solid = np.pad(occupied, 1, constant_values=True).astype(np.uint8)
    cell = float(rng.uniform(0.5, 2.0))
    a, b = rng.uniform(0, [6 * cell, 5 * cell], (2, 2))
    points = a + np.linspace(0, 1, 4001)[:, None] * (b - a)
    rows, columns = np.nonzero(solid)
    low = np.stack([columns - 1, rows - 1], -1) * cell
    away = np.maximum(np.maximum(low - points[:, None], points[:, None] - low - cell), 0.0)
    true = float(np.hypot(away[..., 0], away[..., 1]).min())
    step = float(np.hypot(*(b - a))) / 4000
    assert true - step <= segment_gap(solid, *a, *b, cell, 9.0) <= true + 1e-9
    assert segment_gap(solid, *a, *b, cell, 0.1) == pytest.approx(min(true, 0.1), abs=step)
