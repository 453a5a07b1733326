"""What a load does to a robot: the drive pulls as hard, and the brakes take up as much, as without it.

With a robot of mass m under a load l, and r = m / (m + l), its acceleration is r times that without load (the same
force), and its top speed sqrt(r) times (the same kinetic energy), so that it comes to a stop within the same way.
Braking in an emergency, which the protective field counts on, is that of the empty robot: brakes are made for the
payload.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.simulation.tasks.placement import Limits


def slowed(robot: RobotSpec, load: float) -> tuple[float, float]:
    """Return (top speed [m/s], acceleration [m/s^2]) under a load [kg]."""
    share = robot.mass / (robot.mass + load)
    return robot.max_speed * math.sqrt(share), robot.max_acceleration * share


def limits_for(limits: Limits, worlds: int, robots: int) -> NDArray[Any]:
    """Return PARAMETERS[B, N], of each robot its own, without load: what its path follower drives it by."""
    params, kinds = limits
    return np.broadcast_to(params if kinds is None else kinds, (worlds, robots)).copy()


def put_on(limits: NDArray[Any], world: int, robot: int, spec: RobotSpec, load: float) -> None:
    """Let a robot's limits be those under a load [kg]."""
    limits["max_speed"][world, robot], limits["max_acceleration"][world, robot] = slowed(spec, load)
