"""Does a robot alone always arrive, and how often? One robot a world, along its routes, on every floor there is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from agents import make_policy
from train.reporting.report import Table, number, with_interval
from train.reporting.rows import Interval, Row, mean_interval
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.simulation.simulator import Simulator

WORLDS = 32  # each a sample
GENERATED = 100  # floors of the layout `aisles`, seeds from 0 on
POLICY, PLANNER = "follow", "astar_turns"
STANDING = 20.0  # [s] in one place that count as not arriving


def alone(seconds: float, seed: int, maps: Sequence[Path]) -> Iterator[Row]:
    """Yield a row for every layout, every map and every generated floor; `seconds` simulated in each world."""
    floors = [make_layout(name) for name in (*LAYOUTS, *map(str, maps))]
    for grid in floors:
        yield {"floor": grid.name, "generated": False, **drive(grid, seconds, seed)}
    for floor in range(GENERATED):
        grid = make_layout("aisles", seed=floor)
        yield {"floor": f"aisles, seed {floor}", "generated": True, **drive(grid, seconds, seed)}


def drive(grid: GridMap, seconds: float, seed: int, worlds: int = WORLDS) -> Row:
    """Drive one robot in each of `worlds` worlds; return goals, longest time in one place [s] and shelf contacts."""
    config = EnvConfig(num_agents=1, planner=PLANNER, action_repeat=2)
    simulator = Simulator(config, worlds, grid=grid)
    policy, rng = make_policy(POLICY, config), np.random.default_rng(seed)
    observation = simulator.reset(seed)
    robots = simulator.robots[:, 0]
    left, since = simulator.state.pose[:, 0, :2].copy(), np.zeros(worlds)
    longest = 0.0
    for step in range(max(1, round(seconds / (config.action_repeat * config.time_step)))):
        observation = simulator.step(policy.act(observation, rng))
        now = (step + 1) * config.action_repeat * config.time_step
        moved = np.hypot(*(simulator.state.pose[:, 0, :2] - left).T) > 0.5 * grid.cell_size
        left[moved], since[moved] = simulator.state.pose[moved, 0, :2], now
        longest = max(longest, float((now - since).max()))
    ratio = robots["totals"]["driven_to_goals"] / np.maximum(robots["totals"]["planned"], grid.cell_size)
    goals = mean_interval(3600.0 * count / seconds for count in robots["totals"]["goals"].tolist())
    return {
        "robot_hours": worlds * seconds / 3600, "longest_standing_s": longest,
        "shelf_contacts": int(robots["totals"]["hits_shelf"].sum()), "worlds": worlds,
        "fewest_goals": int(robots["totals"]["goals"].min()), "driven_over_planned": float(ratio.max()),
        "goals_per_robot_hour": goals.mean, "goals_low": goals.low, "goals_high": goals.high,
    }  # fmt: skip


def alone_table(rows: Sequence[Row]) -> Table:
    """Return the table of `alone`'s rows: the generated floors in one line, and what all come to in the note."""
    header = ("floor", "robot-hours", "longest in one place [s]", "shelf contacts", "goals/robot-h")
    cells = []
    for row in (row for row in rows if not row["generated"]):
        goals = Interval(row["goals_per_robot_hour"], row["goals_low"], row["goals_high"], row["worlds"])
        cells.append(_line(row["floor"], [row], goals))
    generated = [row for row in rows if row["generated"]]
    if generated:
        goals = mean_interval(row["goals_per_robot_hour"] for row in generated)
        cells.append(_line(f"aisles, {len(generated)} seeds", generated, goals))
    late = sum(row["longest_standing_s"] > STANDING for row in rows)
    note = (
        f"One robot a world under {POLICY}, planner {PLANNER}; goals with 95% intervals over worlds, or over floors. "
        f"In one place: within half a cell. {late} of {len(rows)} floors saw a robot there for over {STANDING:g} s in "
        f"{number(sum(row['robot_hours'] for row in rows))} robot-hours."
    )
    return Table("A robot alone", header, tuple(cells), note)


def _line(name: str, rows: Sequence[Row], goals: Interval) -> tuple[str, ...]:
    return (
        name, number(sum(row["robot_hours"] for row in rows)), number(max(row["longest_standing_s"] for row in rows)),
        str(sum(row["shelf_contacts"] for row in rows)), with_interval(goals),
    )  # fmt: skip
