"""Figures of a fleet from its poses, counted like the simulator's: metres, standing, near misses, contacts, goals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.evaluation.audit.bodies import AuditFleet, body_of, gap, outline_of
from warehouse_env.config import EnvConfig
from warehouse_env.kernel import kernel
from warehouse_env.simulation.state import GAP_HORIZON, ROBOT
from warehouse_env.simulation.traffic.waits import SLOW

PRESENT, LOADED, AT_ROBOT, AT_SHELF, AT_PERSON, UNDER_WAY = 1, 2, 4, 8, 16, 32
"""Bits of a vehicle at a moment: it is present, carries something, touches something, has to drive."""
MOMENT = np.dtype(
    [
        ("bits", np.uint8),
        ("goal", np.int32),  # row * columns + column of the cell
        ("line", np.int32),  # which of the lines of the orders
        ("goals", np.int32),  # reached so far
        ("planned", np.float32),  # [m] to them
    ]
)
_NEAR, _CONTACT = 1, 2  # of a pair: near and untouched, in a contact episode
_STANDS_WITHIN = 1.0  # [m]


@kernel
def _arrive(r, reached, planned, seconds, late):
    """Count the goals that a robot has `reached` since the last moment."""
    if reached > 0:
        task, totals = r["task"], r["totals"]
        r["events"]["arrived"] = 1
        totals["goals"] += reached
        totals["late_goals"] += reached if late else 0
        totals["longest_age"], task["age"] = max(totals["longest_age"], task["age"]), 0
        totals["planned"] = planned
        totals["driven_to_goals"] += totals["distance"] - totals["distance_at_goal"]
        totals["distance_at_goal"], totals["finish_time"] = totals["distance"], seconds


@kernel
def _step_robots(robots, poses, before, moments, was, seconds, dt, late):
    """Advance each robot's clocks and totals by a moment; was, before: moments and poses a moment ago."""
    for i in range(robots.shape[0]):
        r = robots[i]
        motion, task, events, totals, clocks = r["motion"], r["task"], r["events"], r["totals"], r["clocks"]
        x, y, heading = poses[i, 0], poses[i, 1], poses[i, 2]
        dx, dy = x - before[i, 0], y - before[i, 1]
        seen = (moments[i]["bits"] & was[i]["bits"] & PRESENT) != 0
        way = math.sqrt(dx * dx + dy * dy) if seen else 0.0
        ahead = dx * (math.cos(heading) + math.cos(before[i, 2])) + dy * (math.sin(heading) + math.sin(before[i, 2]))
        motion["x"], motion["y"], motion["heading"] = x, y, heading
        motion["cos"], motion["sin"] = math.cos(heading), math.sin(heading)
        motion["speed"] = (way if ahead >= 0.0 else -way) / dt if dt > 0.0 else 0.0
        events["arrived"] = events["hit_robot"] = events["hit_shelf"] = events["hit_person"] = events["near_miss"] = 0
        events["touching"] = (moments[i]["bits"] & (AT_ROBOT | AT_SHELF | AT_PERSON)) != 0
        stood, task["acting"] = task["alive"] == 0, task["alive"]
        task["alive"] = (moments[i]["bits"] & PRESENT) != 0 and (moments[i]["bits"] & UNDER_WAY) != 0
        events["gap"] = GAP_HORIZON
        began = moments[i]["bits"] & ~was[i]["bits"]
        events["hit_shelf"], events["hit_person"] = (began & AT_SHELF) != 0, (began & AT_PERSON) != 0
        totals["hits_shelf"] += events["hit_shelf"]
        totals["hits_person"] += events["hit_person"]
        totals["distance"] += way
        r["on_route"]["position"] = 0.0 if moments[i]["line"] != was[i]["line"] else r["on_route"]["position"] + way
        if (
            dt == 0.0
            or (stood and task["alive"] != 0)
            or (x - clocks["anchor_x"]) ** 2 + (y - clocks["anchor_y"]) ** 2 > _STANDS_WITHIN**2
        ):
            clocks["anchor_x"], clocks["anchor_y"], clocks["standing_time"] = x, y, 0.0
        elif task["alive"] != 0:
            clocks["standing_time"] += dt
            totals["longest_standing"] = max(totals["longest_standing"], clocks["standing_time"])
        clocks["stalled_time"] = clocks["standing_time"]
        if dt > 0.0 and task["alive"] != 0:
            totals["lived"] += 1
            totals["waited"] += abs(motion["speed"]) < SLOW
            task["age"] += 1
        _arrive(r, moments[i]["goals"] - was[i]["goals"], moments[i]["planned"], seconds, late)


@kernel
def _gap_of(a, b, one, other, apart):
    """Return the gap [m] between two robots' bodies, negative if they overlap, and `apart` if their centres are so far.

    one, other: the FleetBody of each.
    """
    a, b = a["motion"], b["motion"]
    x, y = a["x"] - one.back * a["cos"], a["y"] - one.back * a["sin"]
    to_x, to_y = b["x"] - other.back * b["cos"], b["y"] - other.back * b["sin"]
    if (to_x - x) ** 2 + (to_y - y) ** 2 > apart * apart:
        return apart
    return gap(outline_of((x, y, a["cos"], a["sin"]), one), outline_of((to_x, to_y, b["cos"], b["sin"]), other))


@kernel
def _place_of(i, j, active, count):
    """Return the row of a pair in `active`: its own, or `count` if it is new."""
    for k in range(count):
        if active[k, 0] == i and active[k, 1] == j:
            return k
    return count


@kernel
def _note(i, j, found, touch, robots, active, count, near):
    """Note the gap `found` [m] of robots i < j, and a contact that begins; return how many pairs are active."""
    for r in (robots[i], robots[j]):
        r["events"]["gap"] = min(r["events"]["gap"], found)
        r["totals"]["min_gap"] = min(r["totals"]["min_gap"], found)
    k = _place_of(i, j, active, count) if found < near else active.shape[0]
    if k == active.shape[0]:
        return count
    if k == count:
        active[k, 0], active[k, 1], active[k, 2] = i, j, _NEAR
    active[k, 3] = 1
    begins = touch and active[k, 2] != _CONTACT
    if touch:
        active[k, 2] = _CONTACT
        for r in (robots[i], robots[j]):
            r["events"]["touching"] = 1
            r["events"]["hit_robot"] += begins
            r["totals"]["hits_robot"] += begins
    return max(count, k + 1)


@kernel
def _end_pairs(robots, active, count):
    """Drop the active pairs that are near no more, and count near misses; return how many are left."""
    kept = 0
    for k in range(count):
        if active[k, 3] != 0:
            active[kept] = active[k]
            active[kept, 3] = 0
            kept += 1
        elif active[k, 2] == _NEAR:
            for r in (robots[active[k, 0]], robots[active[k, 1]]):
                r["events"]["near_miss"] += 1
                r["totals"]["near_misses"] += 1
    return kept


@kernel
def _look_at_pairs(robots, active, count, bits, near, fleet):
    """Begin and end near misses and contacts of pairs; active int64[K, 4]: two robots, status, whether near now.

    A pair touches if its bodies overlap, or both report to touch a robot. Returns how many are active.
    """
    apart, back = 2.0 * fleet.radius + GAP_HORIZON, 0.0
    for body in fleet.bodies:
        back = max(back, abs(body.back))
    order = np.argsort(robots["motion"]["x"])
    for n in range(order.size):
        for m in range(n + 1, order.size):
            if robots[order[m]]["motion"]["x"] - robots[order[n]]["motion"]["x"] > apart + 2.0 * back:
                break
            i, j = min(order[n], order[m]), max(order[n], order[m])
            if (bits[i] & bits[j] & PRESENT) == 0:
                continue
            found = _gap_of(robots[i], robots[j], body_of(i, fleet), body_of(j, fleet), apart)
            if found < apart:
                touch = found < 0.0 or (found < near and (bits[i] & bits[j] & AT_ROBOT) != 0)
                count = _note(i, j, 0.0 if touch else found, touch, robots, active, count, near)
    return _end_pairs(robots, active, count)


class FleetFigures:
    """The records ROBOT[1, N] of a fleet, updated moment by moment."""

    def __init__(self, config: EnvConfig) -> None:
        count = config.num_agents
        self.robots: NDArray[Any] = np.zeros((1, count), dtype=ROBOT)
        self.robots["totals"]["min_gap"] = GAP_HORIZON
        self.robots["shield"]["vetoed_by"] = self.robots["traffic"]["yields_to"] = -1
        self.moments = -1
        self._config, self._fleet = config, AuditFleet.of(config)
        self._active = np.zeros((8 * count, 4), dtype=np.int64)
        self._count = 0
        self._pose: NDArray[np.float64] | None = None
        self._was: NDArray[Any] | None = None

    @property
    def seconds(self) -> float:
        """Time since the first moment [s]."""
        return self.moments * self._config.time_step

    def take(self, pose: NDArray[np.float32], moment: NDArray[Any]) -> None:
        """Take the next moment: pose float32[N, 3], moment MOMENT[N]."""
        self.moments += 1
        now, robots = pose.astype(np.float64), self.robots[0]
        before, was = (now, moment) if self._pose is None or self._was is None else (self._pose, self._was)
        dt = self._config.time_step if self.moments else 0.0
        late = self.moments > self._config.max_steps // 2
        _step_robots(robots, now, before, moment, was, self.seconds, dt, late)
        self._count = _look_at_pairs(
            robots, self._active, self._count, moment["bits"], self._config.near_miss_gap, self._fleet
        )
        self._pose, self._was = now, moment
