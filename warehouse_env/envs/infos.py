"""What an `info` dict says about one robot's last step; kept lean, for it is built for every robot at every step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.simulation.rewards import REWARD_TERMS

if TYPE_CHECKING:
    from warehouse_env.simulation.simulator import Simulator

Rows = slice | NDArray[np.int64]


def robot_infos(simulator: Simulator, world: int, rows: Rows) -> list[dict[str, Any]]:
    """Return one fresh dict per chosen robot of a world, of plain Python numbers about the last step.

    "reward_terms": the named terms before weighting; "goals": goals reached; "collisions_robot",
    "collisions_shelf": contact episodes that began; "near_misses"; "touching"; "gap" [m] to the nearest
    robot; "progress" [m] along the route.
    """
    events = simulator.events
    columns = (
        simulator.reward_terms[world][rows].tolist(),
        events.arrived[world][rows].tolist(),
        events.hit_robot[world][rows].tolist(),
        events.hit_shelf[world][rows].tolist(),
        events.near_miss[world][rows].tolist(),
        events.touching[world][rows].tolist(),
        events.gap[world][rows].tolist(),
        events.progress[world][rows].tolist(),
    )
    return [
        {
            "reward_terms": dict(zip(REWARD_TERMS, terms, strict=True)),
            "goals": int(arrived),
            "collisions_robot": hit_robot,
            "collisions_shelf": hit_shelf,
            "near_misses": near_miss,
            "touching": touching,
            "gap": gap,
            "progress": progress,
        }
        for terms, arrived, hit_robot, hit_shelf, near_miss, touching, gap, progress in zip(*columns, strict=True)
    ]
