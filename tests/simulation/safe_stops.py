"""The shield's promise, checked after every env step: all robots can stop at once without touching anything.

It shares no code with shield.py: kinematics.drive drives every stop, and all pairs of robots are compared at every
substep.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from warehouse_env.kernel import kernel, part
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import body_at, rectangles_touch
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.kinematics import approach, chassis_of, drive
from warehouse_env.simulation.physics.people import PACE, RADIUS, distance_to_body
from warehouse_env.simulation.physics.trigonometry import ZERO, sin_cos
from warehouse_env.simulation.simulator import Simulator

NONE, SHELF, PERSON = -1, -2, -3


@part
def _stop(r, p, stop):
    """Write the body's centre x, y [m], cosine and sine at each substep of a full stop, float32[T, 4]."""
    motion = r["motion"]
    x, y, heading, speed = motion["x"], motion["y"], motion["heading"], motion["speed"]
    c, s = motion["cos"], motion["sin"]
    for n in range(stop.shape[0]):
        if n % p["substeps"] == 0:
            rate = (approach(speed, ZERO, p["max_acceleration"] * p["time_step"]) - speed) / p["time_step"]
        slower = speed + rate * p["dt"]
        if speed != ZERO:
            x, y, heading = drive(
                (x, y, heading), speed, slower, motion["steer"], motion["steer"], chassis_of(p), p["dt"]
            )
            s, c = sin_cos(heading)
        speed = slower
        stop[n, 0], stop[n, 1], stop[n, 2], stop[n, 3] = x - p["offset"] * c, y - p["offset"] * s, c, s


@kernel
def _find_fault(robots, persons, p, kinds, floor):
    """Return (robot, the other robot, SHELF or PERSON that its stop touches); NONE as the other if no stop does."""
    stops = np.empty((robots.shape[0], p["stop_samples"], 4), np.float32)
    for i in range(robots.shape[0]):
        _stop(robots[i], kind_of(i, p, kinds), stops[i])
    for i in range(robots.shape[0]):
        own = kind_of(i, p, kinds)
        for n in range(stops.shape[1]):
            x, y, c, s = stops[i, n]
            other = NONE
            body = body_at(x, y, c, s, own)
            if body_touches_shelf(body, floor):
                other = SHELF
            for o in persons:
                moves = robots[i]["motion"]["speed"] != ZERO and (n == 0 or (stops[i, n] != stops[i, n - 1]).any())
                comes = RADIUS + PACE * np.float32(n) * p["dt"]
                if moves and distance_to_body(o["x"], o["y"], x, y, c, s, own) <= comes:
                    other = PERSON
            for j in range(i):
                to_x, to_y, to_c, to_s = stops[j, n]
                theirs = kind_of(j, p, kinds)
                if rectangles_touch(body, body_at(to_x, to_y, to_c, to_s, theirs)):
                    other = j
            if other != NONE:
                return i, other
    return 0, NONE


def assert_all_can_stop(simulator: Simulator) -> None:
    """Fail if a robot of a simulator under the shield cannot stop clear of all others, shelves and people."""
    params, kinds = simulator._limits
    for world in range(simulator.num_worlds):
        robots, persons = simulator._planned[world], simulator.people.persons[world]
        robot, other = _find_fault(robots, persons, params[0], kinds, simulator._floor)
        what = {SHELF: "a shelf", PERSON: "a person"}.get(other, f"robot {other}")
        assert other == NONE, f"world {world}: robot {robot} cannot stop clear of {what}"


@pytest.fixture
def checked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check every Simulator under the shield after each of its env steps."""
    step = Simulator.step

    def checked_step(simulator: Simulator, actions: Any) -> Any:
        observation = step(simulator, actions)
        if simulator.config.traffic_spec.shield:
            assert_all_can_stop(simulator)
        return observation

    monkeypatch.setattr(Simulator, "step", checked_step)
