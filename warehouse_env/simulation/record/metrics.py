"""Totals over an episode -> one row of numbers, of a world or of each robot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.simulation.state import GAP_HORIZON


def episode_row(
    robots: NDArray[Any], seconds: float, config: EnvConfig, persons: NDArray[Any] | None = None
) -> dict[str, float]:
    """Return the metrics of one world.

    robots: ROBOT[N]; seconds since the reset; persons: PERSON[M], if any walk. A pair's contact counts once;
    `collisions_per_km` adds pairs, and contacts with shelves and people. `stuck`: share of robots that for
    `stuck_after` seconds have not advanced 1 m on their route.
    `path_length_m`: driven per goal reached; `path_length_ratio`: driven over planned, over reached goals.
    `waiting_share`: of the robots' time until they were parked, standing; `longest_standing_s`: that any robot stayed
    within a metre of one place, rocking there or not; `longest_without_goal_s`: that any was on the way to one goal.
    `late_goals_per_robot_hour`: in the second half of `max_steps`, when jams have built up; `reroutes`: routes planned
    anew under way.
    Without a reached goal, or with a robot that has not arrived, the figures that need it are nan.
    """
    count = len(robots)
    kilometres = float(robots["totals"]["distance"].sum()) / 1000.0
    pairs = float(robots["totals"]["hits_robot"].sum()) / 2.0
    shelves, people = float(robots["totals"]["hits_shelf"].sum()), float(robots["totals"]["hits_person"].sum())
    goals = float(robots["totals"]["goals"].sum())
    planned, driven = float(robots["totals"]["planned"].sum()), float(robots["totals"]["driven_to_goals"].sum())
    stuck = (robots["clocks"]["stalled_time"] > config.stuck_after) & (robots["task"]["alive"] != 0)
    one_shot = config.tasks == "one_shot"
    arrived = robots["totals"]["goals"] > 0
    times = np.where(arrived, robots["totals"]["finish_time"], seconds)
    gap = float(robots["totals"]["min_gap"].min())
    lived = int(robots["totals"]["lived"].sum())
    late = float(late_seconds(seconds, config))
    return {
        "seconds": seconds,
        "robot_km": kilometres,
        "collisions_robot": pairs,
        "collisions_shelf": shelves,
        "collisions_person": people,
        "collisions_per_km": (pairs + shelves + people) / kilometres if kilometres > 0 else math.nan,
        "near_misses": float(robots["totals"]["near_misses"].sum()) / 2.0,
        "min_clearance_m": gap if gap < GAP_HORIZON else math.nan,
        "goals": goals,
        "goals_per_robot_hour": goals / count / seconds * 3600.0 if seconds > 0 else math.nan,
        "late_goals_per_robot_hour": float(robots["totals"]["late_goals"].sum()) / count / late * 3600.0
        if late
        else math.nan,
        "success_rate": float(arrived.mean()),
        "path_length_m": driven / goals if goals else math.nan,
        "path_length_ratio": driven / planned if planned else math.nan,
        "makespan_s": float(times.max()) if one_shot and arrived.all() else math.nan,
        "sum_of_costs_s": float(times.sum()) if one_shot else math.nan,
        "stuck": float(stuck.mean()),
        "waiting_share": float(robots["totals"]["waited"].sum()) / lived if lived else math.nan,
        "longest_standing_s": float(robots["totals"]["longest_standing"].max()),
        "longest_without_goal_s": float(_without_goal(robots, config).max()),
        "reroutes": float(robots["totals"]["reroutes"].sum()),
    } | people_row(persons)


def people_row(persons: NDArray[Any] | None) -> dict[str, float]:
    """Return the metrics of the people PERSON[M] of one world; none where nobody walks.

    `longest_person_kept_s`: that any who wanted to walk had a robot about half a metre away or nearer, without coming a
    metre.
    """
    if persons is None or not len(persons):
        return {}
    return {"longest_person_kept_s": float(persons["longest_kept"].max())}


def late_seconds(seconds: ArrayLike, config: EnvConfig) -> NDArray[np.float64]:
    """Return how long [s] an episode of `seconds` so far has gone on beyond the middle of `max_steps`."""
    half = config.max_steps // 2 * config.action_repeat * config.time_step
    late = np.asarray(seconds, dtype=np.float64) - half
    return np.where(late > config.time_step / 2, late, 0.0)


def robot_rows(robots: NDArray[Any], seconds: NDArray[np.float64], config: EnvConfig) -> list[dict[str, float]]:
    """Return the metrics of each of some robots, whatever world they are in, as `episode_row` names and means them.

    robots: ROBOT[K]; seconds [K] since the resets of their worlds. Only the robot's own are counted: a contact or a
    near miss with another robot counts one for each of the two. `distance_m`: driven in all, to goals or not.
    """
    goals = robots["totals"]["goals"].astype(np.float64)
    gap = robots["totals"]["min_gap"].astype(np.float64)
    columns = {
        "seconds": seconds,
        "distance_m": robots["totals"]["distance"],
        "collisions_robot": robots["totals"]["hits_robot"].astype(np.float64),
        "collisions_shelf": robots["totals"]["hits_shelf"].astype(np.float64),
        "collisions_person": robots["totals"]["hits_person"].astype(np.float64),
        "near_misses": robots["totals"]["near_misses"].astype(np.float64),
        "min_clearance_m": np.where(gap < GAP_HORIZON, gap, math.nan),
        "goals": goals,
        "goals_per_robot_hour": _ratio(goals * 3600.0, seconds),
        "late_goals_per_robot_hour": _ratio(robots["totals"]["late_goals"] * 3600.0, late_seconds(seconds, config)),
        "success_rate": (goals > 0).astype(np.float64),
        "path_length_m": _ratio(robots["totals"]["driven_to_goals"], goals),
        "path_length_ratio": _ratio(robots["totals"]["driven_to_goals"], robots["totals"]["planned"]),
        "stuck": ((robots["clocks"]["stalled_time"] > config.stuck_after) & (robots["task"]["alive"] != 0)).astype(
            np.float64
        ),
        "waiting_share": _ratio(robots["totals"]["waited"], robots["totals"]["lived"]),
        "longest_standing_s": robots["totals"]["longest_standing"].astype(np.float64),
        "longest_without_goal_s": _without_goal(robots, config),
        "reroutes": robots["totals"]["reroutes"].astype(np.float64),
    }
    return [
        dict(zip(columns, row, strict=True))
        for row in zip(*(column.tolist() for column in columns.values()), strict=True)
    ]


def _without_goal(robots: NDArray[Any], config: EnvConfig) -> NDArray[np.float64]:
    """Return the longest time [s] that each robot was on the way to one goal, reached or not."""
    return np.asarray(
        np.maximum(robots["totals"]["longest_age"], robots["task"]["age"]) * config.time_step, dtype=np.float64
    )


def _ratio(part: NDArray[Any], whole: NDArray[Any]) -> NDArray[np.float64]:
    """Divide; nan where the whole is 0."""
    ratio = np.full(len(whole), math.nan)
    np.divide(part, whole, out=ratio, where=whole != 0)
    return ratio
