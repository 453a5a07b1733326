"""A robot that breaks down brakes and stands, whatever its commands."""

from __future__ import annotations

import numpy as np
import pytest

from tests.simulation.worlds import raw, room, stage


def test_it_brakes_and_stands() -> None:
    simulator = stage(room(3, 20), (2.0, 1.5, 0.0, 1.5, 0.2))
    simulator.break_down(0, 0)
    for _ in range(15):  # 1.5 m/s at 1 m/s^2
        assert simulator.state.speed[0, 0] > 0
        simulator.step(raw(simulator, (1.0, 1.5)))
    pose = simulator.state.pose.copy()
    assert np.hypot(*(pose[0, 0, :2] - [2.0, 1.5])) == pytest.approx(1.5**2 / 2, abs=0.02)
    for _ in range(20):
        simulator.step(raw(simulator, (1.0, -1.5)))
        np.testing.assert_array_equal(simulator.state.pose, pose)
    assert (simulator.state.speed[0, 0], simulator.state.steer[0, 0]) == (0.0, np.float32(0.2))
