"""Motion against a fine integration, limits by hand (L = 0.6 m); rectangles that touch and do not, to rounding."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.simulation.reference import WHEELBASE, polygon_distance, ray_to_polygon, rectangle, separation
from tests.simulation.worlds import coast, raw, room, stage
from warehouse_env.config import RobotSpec
from warehouse_env.simulation.physics.geometry import Rectangle, ray_to_rectangle, rectangle_gap, rectangles_touch
from warehouse_env.simulation.physics.kinematics import Chassis, drive
from warehouse_env.simulation.simulator import Simulator

EDGE = 2e-6  # [m] nearer than this to touching, float32 may judge either way
TURNS = [k * math.pi / 12 for k in range(0, 24, 5)]


class Pair(NamedTuple):
    """Two rectangles: centre of the second from the first [m], headings, half lengths and half widths."""

    dx: float
    dy: float
    a1: float
    l1: float
    w1: float
    a2: float
    l2: float
    w2: float

    def arguments(self) -> tuple[Rectangle, Rectangle]:
        one = (0.0, 0.0, math.cos(self.a1), math.sin(self.a1), self.l1, self.w1)
        other = (self.dx, self.dy, math.cos(self.a2), math.sin(self.a2), self.l2, self.w2)
        return Rectangle(*map(F, one)), Rectangle(*map(F, other))

    def touch(self) -> bool:
        return bool(rectangles_touch(*self.arguments()))

    def gap(self) -> float:
        return float(rectangle_gap(*self.arguments()))

    def polygons(self):  # type: ignore[no-untyped-def]
        return (
            rectangle(0, 0, self.a1, self.l1, self.w1),
            rectangle(self.dx, self.dy, self.a2, self.l2, self.w2),
        )

    def apart(self) -> float:
        """Widest gap over all axes [m]; negative: overlap."""
        return float(separation(*self.polygons()))

    def turned(self, angle: float) -> Pair:
        c, s = math.cos(angle), math.sin(angle)
        dx, dy = c * self.dx - s * self.dy, s * self.dx + c * self.dy
        return self._replace(dx=dx, dy=dy, a1=self.a1 + angle, a2=self.a2 + angle)

    def swapped(self) -> Pair:
        return Pair(-self.dx, -self.dy, self.a2, self.l2, self.w2, self.a1, self.l1, self.w1)


sizes = st.floats(0.05, 1.0)
angles = st.floats(-math.pi, math.pi)
pairs = st.builds(Pair, st.floats(-2, 2), st.floats(-2, 2), angles, sizes, sizes, angles, sizes, sizes)

DIAGONAL = math.hypot(0.45, 0.3)
# Default bodies 0.9 x 0.6 that just touch, by hand: (where, pair, direction that parts them)
TOUCHING = {
    "nose to tail": (Pair(0.9, 0.0, 0, 0.45, 0.3, 0, 0.45, 0.3), (1, 0)),
    "side by side, shifted": (Pair(0.8, -0.6, 0, 0.45, 0.3, 0, 0.45, 0.3), (0, -1)),
    "corner to corner": (Pair(0.9, 0.6, 0, 0.45, 0.3, 0, 0.45, 0.3), (1, 1)),
    "corner into flank": (
        Pair(0.0, 0.3 + 0.75 * math.sqrt(0.5), 0, 0.45, 0.3, math.pi / 4, 0.45, 0.3),
        (0, 1),
    ),
    "standing on its corner": (
        Pair(0.45 + DIAGONAL, 0.0, 0, 0.45, 0.3, math.pi - math.atan2(0.3, 0.45), 0.45, 0.3),
        (1, 0),
    ),
}


@pytest.mark.parametrize("angle", TURNS)
@pytest.mark.parametrize("case", TOUCHING)
def test_just_before_and_just_after_touching(case: str, angle: float) -> None:
    pair, (ux, uy) = TOUCHING[case]
    size = math.hypot(ux, uy)
    for shift in (-1e-2, -1e-4, -5e-6, 5e-6, 1e-4, 1e-2):
        moved = pair._replace(dx=pair.dx + shift * ux / size, dy=pair.dy + shift * uy / size).turned(angle)
        assert moved.touch() == (shift < 0), shift
        assert moved.swapped().touch() == (shift < 0), shift
        # parted along the shared axis, or corner from corner
        assert moved.gap() == pytest.approx(max(shift, 0.0), abs=2e-6)


@given(pairs)
def test_contact_and_gap_agree_with_polygons(pair: Pair) -> None:
    apart = pair.apart()
    assume(abs(apart) > EDGE)
    assert pair.touch() == (apart < 0)
    assert pair.gap() == pytest.approx(polygon_distance(*pair.polygons()), abs=5e-6)


@given(st.floats(-3, 3), st.floats(-3, 3), angles, sizes, sizes)
def test_rays_agree_with_polygons(ox: float, oy: float, angle: float, half_length: float, half_width: float) -> None:
    # A ray that grazes a corner may go either way: between the answers for a slightly smaller and larger rectangle.
    origin = np.array([ox, oy])
    eps = 2e-5
    largest = ray_to_polygon(origin, angle, rectangle(0, 0, 0, half_length + eps, half_width + eps))
    smallest = ray_to_polygon(origin, angle, rectangle(0, 0, 0, half_length - eps, half_width - eps))
    values = (ox, oy, math.cos(angle), math.sin(angle), half_length, half_width)
    got = float(ray_to_rectangle(*map(F, values)))
    assert largest - 1e-5 <= got <= smallest + 1e-5


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
