"""Robots off their routes: a robot that has halted far from its route needs a new one, from where it is.

Recovery can take a robot metres away, into another aisle or out of its own, from where no short search leads back.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import kernel
from warehouse_env.simulation.traffic.waits import has_halted

BESIDE = 0.3  # [m] past the widest lateral offset that count as off the route


def far_off(config: EnvConfig, cell_size: float) -> np.float32:
    """Return the distance [m] from its route beyond which a robot is off it: past any offset, and past where a new
    route may begin."""
    return np.float32(max(max(map(abs, config.lateral_offsets)) + BESIDE, cell_size))


@kernel
def find_off_route(robots, routes, far, off):
    """Write into off bool[B, N] which of robots ROBOT[B, N] are off their routes; return how many.

    routes: float32[B, N, R, 2] [m]; far [m]: see far_off.
    """
    found = 0
    for b in range(robots.shape[0]):
        for i in range(robots.shape[1]):
            r = robots[b, i]
            on_route = r["on_route"]
            off[b, i] = False
            if not has_halted(r) or r["manoeuvre"]["arcs"] != 0 or on_route["points"] < 2:
                continue
            k = min(int(on_route["position"] / on_route["spacing"] + np.float32(0.5)), on_route["points"] - 1)
            dx, dy = routes[b, i, k, 0] - r["motion"]["x"], routes[b, i, k, 1] - r["motion"]["y"]
            if dx * dx + dy * dy > far * far:
                off[b, i] = True
                found += 1
    return found
