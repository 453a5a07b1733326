"""The seconds that each command has until a predicted conflict, against polygons and by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.reference import OFFSET, rectangle, separation
from tests.simulation.worlds import lay, room, stage, write
from warehouse_env.config import RobotSpec, SensorSpec
from warehouse_env.simulation.simulator import Simulator

REAR_STEERED = RobotSpec()
SPEEDS, SIDES = (-0.4, 0.0, 0.5, 1.3), (0.0, 0.6, -0.6, 1.2, -1.2)  # the commands
TIMES = 2.4 * np.arange(1, 9) / 8  # [s] looked at


def metres(speed: float, target: float, t: float) -> float:
    """Metres driven in t seconds at 1 m/s^2 towards a speed, by summing up."""
    n = 20000
    at = (np.arange(n) + 0.5) * t / n
    return float(
        np.sum(np.where(target > speed, np.minimum(speed + at, target), np.maximum(speed - at, target))) * t / n
    )


def scene(
    own: tuple[float, ...], *others: tuple[float, ...], robot: RobotSpec = REAR_STEERED, **sensor: Any
) -> Simulator:
    """The own robot with a straight route due east along y = 20 from x = 10; others anywhere."""
    settings = {"speed_levels": SPEEDS, "sensor": SensorSpec(predictions=True, **sensor), "robot": robot}
    simulator = stage(room(40, 40), own, *others, action_type="discrete", **settings)
    lay(simulator, (10.0, 20.0), (29.5, 20.0))
    write(simulator.robots[0, 0], position=own[0] - 10.0, lateral=own[1] - 20.0, bearing=-own[2])
    simulator._observe()
    return simulator


def predictions(simulator: Simulator) -> NDArray[np.float64]:
    """[speed level, lateral offset], shares of 2.4 s."""
    return simulator.observation[0, 0, simulator.layout.slices["predictions"]].astype(np.float64).reshape(4, 5)


def own_body(own: tuple[float, ...], speed: float, side: float, t: float, back: float) -> NDArray[np.float64]:
    """The own body after t seconds of a command, grown by its margin, its centre `back` [m] behind the axle."""
    x, y, heading, now = own
    s = metres(now, speed, t)
    margin = 0.03 + 0.05 * t
    if s <= 0:
        x, y = x + s * math.cos(heading), y + s * math.sin(heading)
    else:
        lateral, left = y - 20.0, max(0.0, 1.0 - s / 1.5)
        y = 20.0 + side + (lateral - side) * left
        heading = math.atan((side - lateral) / 1.5) if left > 0 else 0.0
        x += s
    return rectangle(x - back * math.cos(heading), y - back * math.sin(heading), heading, 0.45 + margin, 0.3 + margin)


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.sampled_from([OFFSET, -OFFSET]))
def test_predictions_agree_with_polygons(seed: int, back: float) -> None:
    rng = np.random.default_rng(seed)
    own = (12.0, 20.0 + rng.uniform(-1, 1), rng.uniform(-0.8, 0.8), rng.choice([0.0, 0.7, 1.3]))
    others = [(12.0 + rng.uniform(-2, 5), 20.0 + rng.uniform(-3, 3), rng.uniform(-3.1, 3.1), rng.uniform(-0.5, 1.5))
              for _ in range(4)]  # fmt: skip
    got = predictions(scene(own, *others, robot=RobotSpec(front_overhang=0.45 - back)))
    for a, speed in enumerate(SPEEDS):
        for b, side in enumerate(SIDES):
            apart = []
            for t in TIMES.tolist():
                body = own_body(own, speed, side if speed > 0 else 0.0, t, back)
                there = [
                    rectangle(x + (v * t - back) * math.cos(h), y + (v * t - back) * math.sin(h), h, 0.45, 0.3)
                    for x, y, h, v in others
                ]
                apart.append(float(separation(body, np.array(there)).min()))
            surely = next((k for k, gap in enumerate(apart) if gap < -2e-3), 8)
            perhaps = next((k for k, gap in enumerate(apart) if gap < 2e-3), 8)
            assert perhaps / 8 <= got[a, b] <= surely / 8


def turning(at: tuple[float, float], heading: float) -> float:
    """Share of the horizon that is free to a robot at (0, 0), facing away from its route, with one that stands by."""
    simulator = scene(
        (12.0 - OFFSET, 20.0, math.pi),
        (12.0 + at[0] + OFFSET * math.cos(heading), 20.0 + at[1] + OFFSET * math.sin(heading), heading),
    )
    return float(predictions(simulator)[3, 0])


def test_a_turn_on_the_spot_sweeps_a_square() -> None:
    assert turning((1.19, 0.0), 0.0) == 0.0  # tail at 0.74
    assert turning((1.21, 0.0), 0.0) == 1.0
    assert turning((0.0, -1.04), 0.0) == 0.0
    assert turning((0.0, -1.06), 0.0) == 1.0
