"""Motion against a fine integration, and limits by hand; L = 0.6 m throughout."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.simulation.reference import WHEELBASE
from tests.simulation.worlds import coast, raw, room, stage
from warehouse_env.config import RobotSpec
from warehouse_env.simulation.physics.kinematics import Chassis, drive
from warehouse_env.simulation.simulator import Simulator

F = np.float32


def moved(x, y, heading, speed, next_speed, steering, next_steering, dt=0.05):  # type: ignore[no-untyped-def]
    """`drive` with float32 arguments, as the step calls it."""
    *controls, dt = (F(v) for v in (speed, next_speed, steering, next_steering, dt))
    chassis = Chassis(F(WHEELBASE), F(-0.5), F(1.5), F(math.radians(60)))
    return tuple(float(v) for v in drive((F(x), F(y), F(heading)), *controls, chassis, dt))


def pose(simulator: Simulator, robot: int = 0) -> tuple[float, float, float]:
    x, y, heading = simulator.state.pose[0, robot].tolist()
    return x, y, heading


def test_speed_keeps_its_limits_and_grows_at_the_limit_of_acceleration() -> None:
    simulator = stage(room(6, 30), (2.0, 3.0, 0.0))
    seen = [0.0]
    for _ in range(30):
        simulator.step(raw(simulator, (1.0, 0.0)))
        seen.append(float(simulator.state.speed[0, 0]))
    assert seen == [pytest.approx(min(0.1 * k, 1.5), abs=1e-6) for k in range(31)]
    assert max(seen) == 1.5
    for _ in range(40):
        simulator.step(raw(simulator, (-1.0, 0.0)))
    assert simulator.state.speed[0, 0] == -0.5
    assert simulator.robots["totals"]["hits_shelf"].sum() == 0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_steering_keeps_its_limit_and_its_rate(side: float) -> None:
    simulator = stage(room(9, 9), (4.0, 4.0, 0.0))
    seen = [0.0]
    for _ in range(12):
        simulator.step(raw(simulator, (0.0, 1.5 * side)))
        seen.append(float(simulator.state.steer[0, 0]) * side)
    assert seen == [pytest.approx(min(0.15 * k, math.radians(60)), abs=1e-6) for k in range(13)]


@given(
    heading=st.floats(-3.14, 3.14),
    speed=st.floats(-0.5, 1.5),
    acceleration=st.floats(-1, 1),
    steering=st.floats(-1.04, 1.04),
    rate=st.floats(-1.5, 1.5),
)
def test_a_substep_agrees_with_a_fine_integration(
    heading: float, speed: float, acceleration: float, steering: float, rate: float
) -> None:
    # Midpoint steering errs by the third power of the substep: under 1 mrad and 0.2 mm at the very limits.
    dt = 0.05
    got = moved(5.0, 6.0, heading, speed, speed + acceleration * dt, steering, steering + rate * dt)
    n = 400
    x, y, b = 5.0, 6.0, heading
    for k in range(n):
        t = (k + 0.5) * dt / n
        v, w = speed + acceleration * t, -(speed + acceleration * t) * math.tan(steering + rate * t) / WHEELBASE
        middle = b + 0.5 * w * dt / n
        x, y, b = x + v * math.cos(middle) * dt / n, y + v * math.sin(middle) * dt / n, b + w * dt / n
    assert got[0] == pytest.approx(x, abs=2e-4)
    assert got[1] == pytest.approx(y, abs=2e-4)
    assert math.remainder(got[2] - b, 2 * math.pi) == pytest.approx(0.0, abs=1.5e-3)


@pytest.mark.parametrize("steering", [math.radians(angle) for angle in (-60, -10, 30)])
def test_the_steered_wheels_of_a_front_steered_vehicle_roll_where_they_point(steering: float) -> None:
    """Ahead of the fixed axle they are turned by minus the angle: no wheel may slide sideways."""
    robot = RobotSpec(front_overhang=0.75)
    assert robot.front_steered
    assert not RobotSpec().front_steered
    simulator = stage(room(14, 14), (7.0, 7.0, 0.3, 1.0, steering), robot=robot)
    places = []
    for _ in range(2):
        x, y, heading = pose(simulator)
        places.append((x + robot.wheelbase * math.cos(heading), y + robot.wheelbase * math.sin(heading), heading))
        coast(simulator, 1)
    (x, y, heading), (to_x, to_y, to_heading) = places
    way = math.atan2(to_y - y, to_x - x)  # of the steered axle: a chord, so along the mean heading
    assert math.remainder(way - (heading + to_heading) / 2 + steering, 2 * math.pi) == pytest.approx(0.0, abs=1e-3)


def test_a_robot_that_breaks_down_brakes_and_stands_whatever_its_commands() -> None:
    simulator = stage(room(3, 20), (2.0, 1.5, 0.0, 1.5, 0.2))
    simulator.break_down(0, 0)
    for _ in range(15):  # 1.5 m/s at 1 m/s^2
        assert simulator.state.speed[0, 0] > 0
        simulator.step(raw(simulator, (1.0, 1.5)))
    stands = simulator.state.pose.copy()
    assert np.hypot(*(stands[0, 0, :2] - [2.0, 1.5])) == pytest.approx(1.5**2 / 2, abs=0.02)
    for _ in range(20):
        simulator.step(raw(simulator, (1.0, -1.5)))
        np.testing.assert_array_equal(simulator.state.pose, stands)
    assert (simulator.state.speed[0, 0], simulator.state.steer[0, 0]) == (0.0, np.float32(0.2))
