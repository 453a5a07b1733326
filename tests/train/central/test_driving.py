"""Lines that robots under a central planner drive: corners become arcs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from train.central.pibt import rounded


def test_corners_become_arcs() -> None:
    quarter = rounded(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]))
    arc = quarter[1:-1]
    np.testing.assert_allclose(np.hypot(*(arc - [0.5, 0.5]).T), 0.5, atol=1e-12)
    np.testing.assert_allclose(arc[[0, -1]], [(0.5, 0.0), (1.0, 0.5)], atol=1e-12)
    eighth = rounded(np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 1.0)]))
    radius = np.hypot(*(eighth[1:-1] - [0.5, 0.5 / math.tan(math.pi / 8)]).T)
    assert radius == pytest.approx(0.5 / math.tan(math.pi / 8))
    straight = np.array([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])
    np.testing.assert_array_equal(rounded(straight), straight[[0, 2]])
