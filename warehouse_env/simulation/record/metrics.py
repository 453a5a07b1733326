"""Totals over an episode -> one row of numbers, of a world or of each robot."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.simulation.state import GAP_HORIZON

Columns = dict[str, NDArray[np.float64]]


def episode_row(
    robots: NDArray[Any], seconds: float, config: EnvConfig, persons: NDArray[Any] | None = None
) -> dict[str, float]:
    """Return the metrics of one world.

    robots: ROBOT[N]; seconds since the reset; persons: PERSON[M], if any walk. A contact or near miss of two robots
    counts once; `collisions_per_km` adds pairs and contacts with shelves and people. `stuck`: share of robots that did
    not advance 1 m on their route for `stuck_after` seconds. `path_length_m`: driven per goal reached;
    `path_length_ratio`: driven over planned, for reached goals. `waiting_share`: share of the robots' time, until they
    were parked, in which they stood. `longest_standing_s`: longest time of any robot within a metre of one place;
    `longest_without_goal_s`: longest time on the way to one goal. `late_goals_per_robot_hour`: in the second half of
    `max_steps`; `reroutes`: routes replanned on the way. Figures that need a goal or an arrival are nan without one.
    """
    return episode_rows(robots[None], np.array([seconds]), config)[0] | people_row(persons)


def episode_rows(robots: NDArray[Any], seconds: NDArray[np.float64], config: EnvConfig) -> list[dict[str, float]]:
    """Return the metrics of worlds ROBOT[K, N], `seconds` [K] after their resets, without people (`episode_row`)."""
    totals, columns = robots["totals"], _columns(robots, seconds, config)
    for pairs in ("collisions_robot", "near_misses"):
        columns[pairs] /= 2.0
    contacts = np.sum([columns[f"collisions_{other}"] for other in ("robot", "shelf", "person")], axis=0)
    kilometres = totals["distance"].sum(axis=1) / 1000.0
    columns = {"seconds": seconds, "robot_km": kilometres} | columns
    columns["collisions_per_km"] = _ratio(contacts, kilometres)
    arrived = totals["goals"] > 0
    times = np.where(arrived, totals["finish_time"], seconds[:, None].astype(np.float32))
    one_shot = config.tasks == "one_shot"
    columns["makespan_s"] = np.where(arrived.all(axis=1) & one_shot, times.max(axis=1), math.nan)
    columns["sum_of_costs_s"] = np.where(one_shot, times.sum(axis=1), math.nan)
    return _rows(columns)


def people_row(persons: NDArray[Any] | None) -> dict[str, float]:
    """Return the metrics of the people PERSON[M] of one world, {} without people.

    `longest_person_kept_s`: longest time that a robot within about half a metre kept a person from walking a metre.
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
    """Return the metrics of single robots, named as in `episode_row`.

    robots: ROBOT[K]; seconds [K] since the resets of their worlds. A contact or near miss of two robots counts for
    each. `distance_m`: driven in all.
    """
    columns = {"seconds": seconds, "distance_m": robots["totals"]["distance"]}
    columns |= _columns(robots[:, None], seconds, config)
    return _rows(columns)


def _rows(columns: Columns) -> list[dict[str, float]]:
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def _columns(robots: NDArray[Any], seconds: NDArray[np.float64], config: EnvConfig) -> Columns:
    """Return the shared columns [K] of K groups ROBOT[K, M], `seconds` [K] after their resets."""
    totals, count = robots["totals"], robots.shape[1]
    added = {name: totals[name].sum(axis=1).astype(np.float64) for name in totals.dtype.fields or ()}
    goals, gap = added["goals"], totals["min_gap"].min(axis=1).astype(np.float64)
    stuck = (robots["clocks"]["stalled_time"] > config.stuck_after) & (robots["task"]["alive"] != 0)
    without_goal = np.maximum(totals["longest_age"], robots["task"]["age"]).max(axis=1) * config.time_step
    return {
        "collisions_robot": added["hits_robot"],
        "collisions_shelf": added["hits_shelf"],
        "collisions_person": added["hits_person"],
        "near_misses": added["near_misses"],
        "min_clearance_m": np.where(gap < GAP_HORIZON, gap, math.nan),
        "goals": goals,
        "goals_per_robot_hour": _ratio(goals / count * 3600.0, seconds),
        "late_goals_per_robot_hour": _ratio(added["late_goals"] / count * 3600.0, late_seconds(seconds, config)),
        "success_rate": (totals["goals"] > 0).mean(axis=1),
        "path_length_m": _ratio(added["driven_to_goals"], goals),
        "path_length_ratio": _ratio(added["driven_to_goals"], added["planned"]),
        "stuck": stuck.mean(axis=1),
        "waiting_share": _ratio(added["waited"], added["lived"]),
        "longest_standing_s": totals["longest_standing"].max(axis=1).astype(np.float64),
        "longest_without_goal_s": without_goal.astype(np.float64),
        "reroutes": added["reroutes"],
    }


def _ratio(part: NDArray[Any], whole: NDArray[Any]) -> NDArray[np.float64]:
    """Divide; nan where the whole is 0."""
    ratio = np.full(len(whole), math.nan)
    np.divide(part, whole, out=ratio, where=whole != 0)
    return ratio
