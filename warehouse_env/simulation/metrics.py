"""Totals over an episode -> one row of numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.simulation.state import GAP_HORIZON


def episode_row(robots: NDArray[Any], seconds: float, config: EnvConfig) -> dict[str, float]:
    """Return the metrics of one world.

    robots: ROBOT[N]; seconds since the reset. A pair's contact counts once; `collisions_per_km` adds pairs and
    shelf contacts. `stuck`: share of robots that for `stuck_after` seconds have not advanced 1 m on their route.
    `path_length_m`: driven per goal reached; `path_length_ratio`: driven over planned, over reached goals.
    Without a reached goal, or with a robot that has not arrived, the figures that need it are nan.
    """
    count = len(robots)
    kilometres = float(robots["distance"].sum()) / 1000.0
    pairs = float(robots["hits_robot"].sum()) / 2.0
    shelves = float(robots["hits_shelf"].sum())
    goals = float(robots["goals"].sum())
    planned, driven = float(robots["planned"].sum()), float(robots["driven_to_goals"].sum())
    stuck = (robots["stalled_time"] > config.stuck_after) & (robots["alive"] != 0)
    one_shot = config.tasks == "one_shot"
    arrived = robots["goals"] > 0
    times = np.where(arrived, robots["finish_time"], seconds)
    gap = float(robots["min_gap"].min())
    return {
        "seconds": seconds,
        "robot_km": kilometres,
        "collisions_robot": pairs,
        "collisions_shelf": shelves,
        "collisions_per_km": (pairs + shelves) / kilometres if kilometres > 0 else math.nan,
        "near_misses": float(robots["near_misses"].sum()) / 2.0,
        "min_clearance_m": gap if gap < GAP_HORIZON else math.nan,
        "goals": goals,
        "goals_per_robot_hour": goals / count / seconds * 3600.0 if seconds > 0 else math.nan,
        "success_rate": float(arrived.mean()),
        "path_length_m": driven / goals if goals else math.nan,
        "path_length_ratio": driven / planned if planned else math.nan,
        "makespan_s": float(times.max()) if one_shot and arrived.all() else math.nan,
        "sum_of_costs_s": float(times.sum()) if one_shot else math.nan,
        "stuck": float(stuck.mean()),
    }
