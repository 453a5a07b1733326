"""Rectangles that touch, nearly touch and do not, in any rotation; tolerances are float32's at a few metres."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.simulation.reference import polygon_distance, ray_to_polygon, rectangle, separation
from warehouse_env.simulation.physics.geometry import Rectangle, ray_to_rectangle, rectangle_gap, rectangles_touch

F = np.float32
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
