"""The batched step: command, move, judge contacts, advance along the routes; then observe.

Two entries, `advance` and `observe`, since tasks and routes may change between them. Each does one world after another;
for all threads, the Simulator hands out parts of the worlds.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.observation import EGO, NEIGHBOUR
from warehouse_env.simulation import buckets, contact, prediction, sensing, tracking
from warehouse_env.simulation.kernel import inline, kernel
from warehouse_env.simulation.kinematics import approach
from warehouse_env.simulation.rewards import write_terms
from warehouse_env.simulation.state import GAP_HORIZON
from warehouse_env.simulation.trigonometry import ONE, ZERO

_RAW = 2
_HORIZON = np.float32(GAP_HORIZON)
_SLOW = np.float32(0.1)  # [m/s] under which a robot counts as waiting


@inline
def _begin(r):  # type: ignore[no-untyped-def]
    """Clear the events of the last env step."""
    r["acting"] = r["alive"]
    r["progress"] = ZERO
    r["gap"] = _HORIZON
    r["arrived"] = 0
    r["touching"] = 0
    r["hit_robot"] = 0
    r["hit_shelf"] = 0
    r["near_miss"] = 0
    r["previous_speed"] = r["target_speed"]
    r["previous_steer"] = r["target_steer"]


@inline
def _command(r, route, first, second, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Turn the action into an acceleration and a steering rate for one physics step."""
    if r["alive"] == 0:
        r["acceleration"] = ZERO
        r["steer_rate"] = ZERO
        return
    dt = p["time_step"]
    if p["action_type"] == _RAW:
        r["acceleration"] = first
        r["steer_rate"] = second
        r["target_speed"] = r["speed"] + first * dt
        r["target_steer"] = r["steer"] + second * dt
        return
    tracking.follow(r, route, first, second, p, solid, clearance)
    next_speed = approach(r["speed"], r["target_speed"], p["max_acceleration"] * dt)
    next_steer = approach(r["steer"], r["target_steer"], p["max_steer_rate"] * dt)
    r["acceleration"] = (next_speed - r["speed"]) / dt
    r["steer_rate"] = (next_steer - r["steer"]) / dt


@inline
def _end(r, route, p):  # type: ignore[no-untyped-def]
    """Advance along the route after a physics step; return 1 on arrival."""
    if r["alive"] == 0:
        return 0
    dt = p["time_step"]
    r["progress"] += tracking.locate(r, route)
    if r["position"] > r["milestone"] + ONE:
        r["milestone"] = r["position"]
        r["stalled_time"] = ZERO
    else:
        r["stalled_time"] += dt
    r["waiting_time"] = r["waiting_time"] + dt if abs(r["speed"]) < _SLOW else ZERO
    r["contact_time"] = r["contact_time"] + dt if r["touching"] != 0 else ZERO
    if r["arrived"] != 0:
        return 0
    dx, dy = r["goal_x"] - r["x"], r["goal_y"] - r["y"]
    if dx * dx + dy * dy > p["arrival_radius"] * p["arrival_radius"]:
        return 0
    r["arrived"] = 1
    if p["one_shot"] != 0:
        r["alive"] = 0
        r["speed"] = ZERO
    return 1


@inline
def _total(r):  # type: ignore[no-untyped-def]
    """Add the env step's events to the episode's totals."""
    r["hits_robot"] += r["hit_robot"]
    r["hits_shelf"] += r["hit_shelf"]
    r["near_misses"] += r["near_miss"]
    r["min_gap"] = min(r["min_gap"], r["gap"])


@kernel
def _advance_world(robots, routes, actions, stamps, pairs, heads, nexts, side, clock, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Advance one world by one env step; return the number of arrivals."""
    arrivals = 0
    for i in range(robots.shape[0]):
        _begin(robots[i])
    for repeat in range(p["repeat"]):
        buckets.fill(robots, heads, nexts, p["offset"], side)
        count = contact.list_pairs(robots, heads, nexts, side, p, pairs)
        for i in range(robots.shape[0]):
            _command(robots[i], routes[i], actions[i, 0], actions[i, 1], p, solid, clearance)
        for _ in range(p["substeps"]):
            for i in range(robots.shape[0]):
                contact.try_motion(robots[i], p)
            contact.keep_off_shelves(robots, p, solid, clearance)
            contact.keep_off_robots(robots, pairs, count, p)
            contact.accept_motion(robots)
        contact.judge_pairs(robots, pairs, count, stamps, clock + repeat, p)
        contact.end_shelf_contacts(robots, p, solid, clearance)
        for i in range(robots.shape[0]):
            arrivals += _end(robots[i], routes[i], p)
    for i in range(robots.shape[0]):
        _total(robots[i])
    return arrivals


@kernel
def _observe_world(robots, routes, heads, nexts, side, p, rays, table, weights, solid, out, terms, reward):  # type: ignore[no-untyped-def]
    """Write observations, reward terms and rewards of one world."""
    ego = p["rays"]
    route = ego + EGO
    near = route + 2 * p["route_points"]
    buckets.fill(robots, heads, nexts, p["offset"], side)
    for i in range(robots.shape[0]):
        r = robots[i]
        row = out[i]
        cx, cy = r["x"] - p["offset"] * r["cos"], r["y"] - p["offset"] * r["sin"]
        sensing.scan_shelves(cx, cy, r["cos"], r["sin"], p["lidar_range"], solid, p["cell"], rays, row)
        sensing.look_around(i, robots, heads, nexts, side, p, rays, row, near)
        sensing.write_neighbours(i, robots, p, row, near)
        for k in range(p["rays"]):
            row[k] = ONE / (ONE + row[k])
        sensing.write_ego_and_route(r, routes[i], p, row, ego)
        if p["predictions"] != 0:
            prediction.write_predictions(row, ego, route, near, table, p, near + NEIGHBOUR * p["neighbours"])
        reward[i] = write_terms(r, p, weights, terms[i])


@kernel
def advance(robots, routes, actions, stamps, pairs, heads, nexts, side, clocks, params, solid, clearance):  # type: ignore[no-untyped-def]
    """Advance all worlds by one env step; return the number of arrivals. Leading axis of the arrays: world.

    robots ROBOT[B, N]; routes float32[B, N, R, 2] [m]; actions float32[B, N, 2]: speed [m/s] and offset [m], or raw
    acceleration and steering rate; stamps int32[B, N, N]; pairs int32[B, P, 3], heads int32[B, rows, columns] and
    nexts int32[B, N] are scratch; clocks int32[B] physics steps since the reset, advanced here.
    """
    arrivals = 0
    p = params[0]
    for b in range(robots.shape[0]):
        arrivals += _advance_world(
            robots[b], routes[b], actions[b], stamps[b], pairs[b], heads[b], nexts[b], side, clocks[b],
            p, solid, clearance,
        )  # fmt: skip
        clocks[b] += p["repeat"]
    return arrivals


@kernel
def observe(robots, routes, heads, nexts, side, params, rays, table, weights, solid, out, terms, reward):  # type: ignore[no-untyped-def]
    """Write observations float32[B, N, D], reward terms float32[B, N, T] and rewards float32[B, N] of all worlds."""
    p = params[0]
    for b in range(robots.shape[0]):
        _observe_world(
            robots[b], routes[b], heads[b], nexts[b], side, p, rays, table, weights, solid, out[b], terms[b], reward[b]
        )
