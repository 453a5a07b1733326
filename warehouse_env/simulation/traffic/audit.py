"""The checked mode: after every physics step, all robots must be able to stop at once without touching anything.

It shares no code with shield.py: kinematics.drive drives every stop, and all pairs of robots are compared at every
substep. It is slow, and meant for tests and doubts.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import UnsafeError
from warehouse_env.kernel import kernel, part
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import body_at, rectangles_touch
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.kinematics import approach, chassis_of, drive
from warehouse_env.simulation.physics.people import PACE, RADIUS, distance_to_body
from warehouse_env.simulation.physics.trigonometry import ZERO, sin_cos

STEP, FIRST, SECOND = 0, 1, 2  # of a fault: physics step since the reset, robot, the other robot or SHELF
SHELF, NONE, PERSON = -1, -2, -3
SWITCH = (
    "WAREHOUSE_CHECK_FIELD"  # environment variable: 1 checks every Simulator with a protective field made from then
)


def is_wanted() -> bool:
    """Return whether the checked mode is on."""
    return os.environ.get(SWITCH, "0") not in ("", "0")


def raise_fault(faults: NDArray[Any]) -> None:
    """Raise UnsafeError for the first world that has a fault, int32[B, 3] as `find_fault` writes them."""
    if not faults[:, STEP].any():
        return
    world = int(faults[:, STEP].argmax())
    step, first, second = faults[world].tolist()
    what = {SHELF: "a shelf", PERSON: "a person"}.get(second, f"robot {second}")
    raise UnsafeError(
        f"world {world}, physics step {step}: robot {first} cannot stop clear of {what}; "
        "the protective field should not have let it come to this"
    )


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
def find_fault(robots, persons, clock, p, kinds, floor, fault):
    """Write (clock, i, j, SHELF or PERSON) into `fault` int32[3] for robots whose stops touch, unless one is there."""
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
            if other != NONE and fault[STEP] == 0:
                fault[STEP], fault[FIRST], fault[SECOND] = clock, i, other
