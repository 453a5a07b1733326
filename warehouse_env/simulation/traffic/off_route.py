"""Robots off their routes: a robot that has halted far from its route needs a new one, from where it is.

Recovery can take a robot metres away, into another aisle or out of its own, from where no short search leads back.
"""

import numpy as np

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import kernel, part
from warehouse_env.simulation.traffic.waits import has_halted

BESIDE = 0.3  # [m] past the widest lateral offset that count as off the route


def far_off(config: EnvConfig, cell_size: float) -> np.float32:
    """Return the distance [m] from its route beyond which a robot is off it: past any offset, and past where a new
    route may begin."""
    return np.float32(max(max(map(abs, config.lateral_offsets)) + BESIDE, cell_size))


@part
def is_off_route(r, route, far):
    """Whether a robot has halted far [m] (far_off) from its route float32[R, 2] [m]."""
    on_route, motion = r["on_route"], r["motion"]
    if not has_halted(r) or r["manoeuvre"]["arcs"] != 0 or on_route["points"] < 2:
        return False
    k = min(int(on_route["position"] / on_route["spacing"] + np.float32(0.5)), on_route["points"] - 1)
    dx, dy = route[k, 0] - motion["x"], route[k, 1] - motion["y"]
    return dx * dx + dy * dy > far * far


@kernel
def find_off_route(robots, routes, far, off):
    """Write into off bool[B, N] which of robots ROBOT[B, N] are off their routes; return how many.

    routes: float32[B, N, R, 2] [m]; far [m]: see far_off.
    """
    found = 0
    for b in range(robots.shape[0]):
        for i in range(robots.shape[1]):
            off[b, i] = is_off_route(robots[b, i], routes[b, i], far)
            found += off[b, i]
    return found
