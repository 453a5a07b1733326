"""How well the path follower keeps to its route.

Lateral offsets count twice: over all time, and over the time on the line alone. A new route starts where the robot
stands, often behind its back, and turning round is most of the error whatever the line is like.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from agents import make_policy
from train.reporting.report import Table, number, with_interval
from train.reporting.rows import Interval, Row, mean_interval
from warehouse_env.config import EnvConfig
from warehouse_env.maps.layouts import LAYOUTS
from warehouse_env.simulation.simulator import Simulator

ON_LINE = (0.1, 0.3)  # [m] beside the route and [rad] off its direction from which on a robot counts as on its line
WORLDS = {1: 16, 16: 4}  # robots -> worlds, each a sample
POLICY = "brake"  # stays on its route, and stops for others
PLANNER = "astar_turns"


def tracking(seconds: float, seed: int) -> Iterator[Row]:
    """Yield a row for every layout, 1 and 16 robots; `seconds` simulated each."""
    for robots, worlds in WORLDS.items():
        for layout in LAYOUTS:
            config = EnvConfig(layout=layout, num_agents=robots, planner=PLANNER)
            yield {"layout": layout, "robots": robots, "worlds": worlds, **follow(config, worlds, seconds, seed)}


def follow(config: EnvConfig, worlds: int, seconds: float, seed: int) -> Row:
    """Drive `worlds` worlds for `seconds` simulated; return lateral offsets [m], speed and contacts."""
    simulator = Simulator(config, worlds)
    policy, rng = make_policy(POLICY, config), np.random.default_rng(seed)
    observation = simulator.reset(seed)
    on_line = np.zeros((worlds, config.num_agents), dtype=np.bool_)
    goals = simulator.state.goals.copy()
    steps = max(round(seconds / (config.time_step * config.action_repeat)), 1)
    offsets = np.empty((steps, worlds, config.num_agents))
    settled = np.empty(offsets.shape, dtype=np.bool_)
    for step in range(steps):
        observation = simulator.step(policy.act(observation, rng))
        robots, changed = simulator.robots, simulator.state.goals != goals
        offsets[step] = np.abs(robots["lateral"])
        on_line &= ~changed
        on_line |= (offsets[step] < ON_LINE[0]) & (np.abs(robots["bearing"]) < ON_LINE[1]) & (robots["position"] > 0)
        settled[step] = on_line
        goals = simulator.state.goals.copy()
    return {
        **_offsets("", offsets, np.ones_like(settled)), **_offsets("on_line_", offsets, settled),
        "on_line_share": float(settled.mean()),
        **_totals(simulator, seconds),
    }  # fmt: skip


def _offsets(prefix: str, offsets: NDArray[np.float64], counted: NDArray[np.bool_]) -> Row:
    """Mean with its 95% interval over worlds, 95th percentile and largest of the counted offsets [steps, worlds, N]."""
    worlds = [offsets[:, b][counted[:, b]] for b in range(offsets.shape[1])]
    means = mean_interval(float(one.mean()) for one in worlds if len(one))
    every = np.concatenate(worlds) if counted.any() else np.array([np.nan])
    return {
        f"{prefix}mean_m": means.mean, f"{prefix}mean_low_m": means.low, f"{prefix}mean_high_m": means.high,
        f"{prefix}p95_m": float(np.quantile(every, 0.95)), f"{prefix}max_m": float(every.max()),
    }  # fmt: skip


def _totals(simulator: Simulator, seconds: float) -> Row:
    rows = [simulator.episode_metrics(world) for world in range(simulator.num_worlds)]
    driven = 1000 * sum(row["robot_km"] for row in rows)
    hours = simulator.num_worlds * simulator.num_agents * seconds / 3600
    return {
        "speed_m_per_s": driven / hours / 3600,
        "goals_per_robot_hour": sum(row["goals"] for row in rows) / hours,
        "shelf_contacts": sum(row["collisions_shelf"] for row in rows),
        "robot_contacts": sum(row["collisions_robot"] for row in rows),
    }


def tracking_table(rows: list[Row]) -> Table:
    """Return the table of `tracking`'s rows."""
    header = (
        "layout", "robots", "on the line: mean [cm]", "p95", "max", "all: mean [cm]", "p95", "max",
        "m/s", "goals/robot-h", "shelf contacts",
    )  # fmt: skip
    cells = tuple(
        (
            row["layout"], str(row["robots"]), *_lengths(row, "on_line_"), *_lengths(row, ""),
            number(row["speed_m_per_s"]), number(row["goals_per_robot_hour"]), number(row["shelf_contacts"]),
        )
        for row in rows
    )  # fmt: skip
    note = (
        f"Lateral offset from the route, policy {POLICY}, planner {PLANNER}; means with 95% intervals over worlds. "
        "On the line: from when a robot has first come onto its route until the next one."
    )
    return Table("The path follower's tracking error", header, cells, note)


def _lengths(row: Row, prefix: str) -> tuple[str, str, str]:
    mean = Interval(row[f"{prefix}mean_m"], row[f"{prefix}mean_low_m"], row[f"{prefix}mean_high_m"], row["worlds"])
    return with_interval(mean, 100), number(100 * row[f"{prefix}p95_m"]), number(100 * row[f"{prefix}max_m"])
