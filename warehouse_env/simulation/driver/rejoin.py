"""Rejoining the route: the goal poses of a manoeuvre that leads a robot back to its own route."""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.driver.line import way_point
from warehouse_env.simulation.driver.manoeuvre import put_goal
from warehouse_env.simulation.physics.trigonometry import HALF_PI, ZERO, arc_tan2, wrap

FIRST = np.float32(0.75)  # [m] ahead
APART, FAR_APART = (
    np.float32(0.4),
    np.float32(1.2),
)  # [m] between poses: those that are tried first, and those for lanes
# that a robot can only leave backwards
TURNED = 3  # more headings at the end of the route, where any will do
CRUISE = np.float32(1.3)  # [m/s] that the rest of the route is priced at


@inline
def _write_goals(r, route, apart, goals, p):
    """Write poses along the route, `apart` [m], into goals float32[K + TURNED, GOAL]; return how many."""
    on_route = r["on_route"]
    many = goals.shape[0] - TURNED
    to_go = np.float32(on_route["points"] - 1) * on_route["spacing"] - on_route["position"]
    first, apart = FIRST * p["length_scale"], apart * p["length_scale"]
    last = min(first + apart * np.float32(many - 1), to_go)
    for k in range(many):
        ahead = min(first + apart * np.float32(k), to_go)
        x, y, ux, uy = way_point(r, route, ahead, ZERO)
        heading = arc_tan2(uy, ux)
        put_goal(goals, k, x, y, heading, (last - ahead) / CRUISE)
        if ahead == to_go:
            for quarter in range(1, 1 + TURNED):
                put_goal(goals, k + quarter, x, y, wrap(heading + np.float32(quarter) * HALF_PI), ZERO)
            return k + 1 + TURNED
    return many


@inline
def write_goals(r, route, scratch, p):
    """Write the goals on the robot's route into scratch.near and scratch.far; return how many of each."""
    near = _write_goals(r, route, APART, scratch.near, p)
    return near, _write_goals(r, route, FAR_APART, scratch.far, p)
