"""Yielding to people: the robot that another waits for when its grant ends at a person who cannot walk on.

Nobody passes a robot in an aisle of one cell, and no robot moves beside a person. So two robots that shut a person in
wait for each other, a wait cycle that recovery resolves (deadlock_recovery.py). A single robot waits for itself, as
both do if the cycle persists: it leaves its place.
"""

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.people import gap_to

KEPT = np.float32(1.5)  # [s] after which a person counts as kept
LONG_KEPT = np.float32(3.0)  # [s] after which each robot that keeps it makes room
KEEPS = np.float32(1.5)  # [m] within which robots keep it


@inline
def is_kept(o):
    """Whether robots have kept a person from walking for a while."""
    return o["kept"] > KEPT


@inline
def yields_for(i, o, robots, p, kinds):
    """Return the robot that robot i waits for beside a kept person: the nearest other one that keeps it, or itself."""
    nearest, least = i, KEEPS
    for j in range(robots.shape[0]):
        gap = gap_to(o["x"], o["y"], robots[j], kind_of(j, p, kinds))
        if j != i and gap < least:
            nearest, least = j, gap
    return i if o["kept"] > LONG_KEPT else nearest
