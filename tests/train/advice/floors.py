"""Simulate trials without driving: rows of robots whose goals follow a known curve with noise."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from train.advice.trials import AdvicePlan, Drive, TimeBudget, Trial
from warehouse_env.maps.grid_map import GridMap

Curve = Callable[[float], float]
"""Maps a number of robots to their total goals per hour."""


def floor_of(*lines: str, **more: Any) -> GridMap:
    return GridMap(np.array([[letter == "#" for letter in line] for line in lines]), name="hall", **more)


# Two racks of 2 x 4 cells with aisles of one cell between and around them.
RACKS = floor_of(
    "......", ".####.", ".####.", "......", ".####.", ".####.", "......",
    picks=[(3, 2), (0, 2)], stations=[(0, 0), (6, 5)],
)  # fmt: skip


def driver(
    curves: Mapping[str, Curve], noise: float = 0.0, stuck: Callable[[float], float] = lambda robots: 0.0,
    changed: Mapping[str, float] = {}, salt: int = 0, seconds: Callable[[float], float] = lambda robots: 0.0,
) -> Drive:  # fmt: skip
    """Return a drive function; noise: relative, per episode; changed: extra goals/h by floor name."""

    def row(trial: Trial) -> dict[str, Any]:
        name = f"{trial.floor} {trial.policy} {trial.robots} {trial.seed} {salt}"
        rng = np.random.default_rng(zlib.crc32(name.encode()))
        goals = (curves[trial.policy](trial.robots) + changed.get(trial.floor, 0.0)) / trial.robots
        late, whole = goals * (1 + noise * rng.standard_normal(2))
        return {
            "policy": trial.policy, "robots": trial.robots, "seed": trial.seed, "seconds": trial.seconds,
            "shape": list(trial.grid.shape), "late_goals_per_robot_hour": late, "goals_per_robot_hour": whole,
            "waiting_share": 0.1, "stuck": stuck(trial.robots), "waited": [], "contacts": [], "path_length_m": 20.0,
            "collisions_per_km": 0.0, "took_s": seconds(trial.robots),
        }  # fmt: skip

    return lambda trials: [row(trial) for trial in trials]


def plan_of(grid: GridMap, **changes: Any) -> AdvicePlan:
    """Return a plan for one policy, "ours", with six episodes per measurement."""
    asked = {"policies": ("ours",), "planner": "astar", "seconds": 300.0, "seed": 0, "episodes": 6, "most": 512}
    return AdvicePlan(grid, **{**asked, **changes})


class Slow(TimeBudget):
    """Clock that advances by the rows' stated durations."""

    def __init__(self, minutes: float, drive: Drive) -> None:
        self._passed = 0.0
        super().__init__(minutes)
        self._drive = drive

    def restart(self) -> None:
        """Restart at zero."""
        self._passed = 0.0

    @property
    def spent(self) -> float:
        """Return the seconds since the start or restart."""
        return self._passed

    def drive(self, trials: Sequence[Trial]) -> list[dict[str, Any]]:
        """Drive and advance the clock."""
        rows = self._drive(trials)
        self._passed += sum(row["took_s"] for row in rows)
        return rows
