"""Figures of a fleet from its poses, counted like the simulator's: metres, standing, near misses, contacts, goals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.evaluation.audit.bodies import Fleet, body_of, gap, outline_of
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
def _step_robots(robots, poses, before, moments, was, seconds, dt, late):
    """Advance each robot's clocks and totals by a moment; was, before: moments and poses a moment ago."""
    for i in range(robots.shape[0]):
        r = robots[i]
        x, y, heading = poses[i, 0], poses[i, 1], poses[i, 2]
        dx, dy = x - before[i, 0], y - before[i, 1]
        seen = (moments[i]["bits"] & was[i]["bits"] & PRESENT) != 0
        way = math.sqrt(dx * dx + dy * dy) if seen else 0.0
        ahead = dx * (math.cos(heading) + math.cos(before[i, 2])) + dy * (math.sin(heading) + math.sin(before[i, 2]))
        r["x"], r["y"], r["heading"] = x, y, heading
        r["cos"], r["sin"] = math.cos(heading), math.sin(heading)
        r["speed"] = (way if ahead >= 0.0 else -way) / dt if dt > 0.0 else 0.0
        r["arrived"] = r["hit_robot"] = r["hit_shelf"] = r["hit_person"] = r["near_miss"] = 0
        r["touching"] = (moments[i]["bits"] & (AT_ROBOT | AT_SHELF | AT_PERSON)) != 0
        stood, r["acting"] = r["alive"] == 0, r["alive"]
        r["alive"] = (moments[i]["bits"] & PRESENT) != 0 and (moments[i]["bits"] & UNDER_WAY) != 0
        r["gap"] = GAP_HORIZON
        began = moments[i]["bits"] & ~was[i]["bits"]
        r["hit_shelf"], r["hit_person"] = (began & AT_SHELF) != 0, (began & AT_PERSON) != 0
        r["hits_shelf"] += r["hit_shelf"]
        r["hits_person"] += r["hit_person"]
        r["distance"] += way
        r["position"] = 0.0 if moments[i]["line"] != was[i]["line"] else r["position"] + way
        if (
            dt == 0.0
            or (stood and r["alive"] != 0)
            or (x - r["anchor_x"]) ** 2 + (y - r["anchor_y"]) ** 2 > _STANDS_WITHIN**2
        ):
            r["anchor_x"], r["anchor_y"], r["standing_time"] = x, y, 0.0
        elif r["alive"] != 0:
            r["standing_time"] += dt
            r["longest_standing"] = max(r["longest_standing"], r["standing_time"])
        r["stalled_time"] = r["standing_time"]
        if dt > 0.0 and r["alive"] != 0:
            r["lived"] += 1
            r["waited"] += abs(r["speed"]) < SLOW
            r["age"] += 1
        reached = moments[i]["goals"] - was[i]["goals"]
        if reached > 0:
            r["arrived"] = 1
            r["goals"] += reached
            r["late_goals"] += reached if late else 0
            r["longest_age"], r["age"] = max(r["longest_age"], r["age"]), 0
            r["planned"] = moments[i]["planned"]
            r["driven_to_goals"] += r["distance"] - r["distance_at_goal"]
            r["distance_at_goal"] = r["distance"]
            r["finish_time"] = seconds


@kernel
def _look_at_pairs(robots, active, count, bits, near, fleet):
    """Begin and end near misses and contacts of pairs; active int64[K, 4]: two robots, status, whether near now.

    A pair touches if its bodies overlap, or both report to touch a robot. Returns how many are active.
    """
    apart, back = 2.0 * fleet.radius + GAP_HORIZON, 0.0
    for body in fleet.bodies:
        back = max(back, abs(body.back))
    order = np.argsort(robots["x"])
    for n in range(order.size):
        i = order[n]
        for m in range(n + 1, order.size):
            j = order[m]
            a, b = robots[min(i, j)], robots[max(i, j)]
            if robots[j]["x"] - robots[i]["x"] > apart + 2.0 * back:
                break
            one, other = body_of(min(i, j), fleet), body_of(max(i, j), fleet)
            x, y = a["x"] - one.back * a["cos"], a["y"] - one.back * a["sin"]
            to_x, to_y = b["x"] - other.back * b["cos"], b["y"] - other.back * b["sin"]
            dx, dy = to_x - x, to_y - y
            if (bits[i] & bits[j] & PRESENT) == 0 or dx * dx + dy * dy > apart * apart:
                continue
            own = outline_of((x, y, a["cos"], a["sin"]), one)
            found = gap(own, outline_of((to_x, to_y, b["cos"], b["sin"]), other))
            touch = found < 0.0 or (found < near and (bits[i] & bits[j] & AT_ROBOT) != 0)
            found = 0.0 if touch else found
            a["gap"], b["gap"] = min(a["gap"], found), min(b["gap"], found)
            a["min_gap"], b["min_gap"] = min(a["min_gap"], found), min(b["min_gap"], found)
            if found >= near:
                continue
            k = 0
            while k < count and not (active[k, 0] == min(i, j) and active[k, 1] == max(i, j)):
                k += 1
            if k == active.shape[0]:
                continue
            if k == count:
                active[k, 0], active[k, 1], active[k, 2] = min(i, j), max(i, j), _NEAR
                count += 1
            active[k, 3] = 1
            if touch:
                a["touching"] = b["touching"] = 1
                if active[k, 2] != _CONTACT:
                    active[k, 2] = _CONTACT
                    a["hit_robot"], b["hit_robot"] = a["hit_robot"] + 1, b["hit_robot"] + 1
                    a["hits_robot"], b["hits_robot"] = a["hits_robot"] + 1, b["hits_robot"] + 1
    kept = 0
    for k in range(count):
        a, b = robots[active[k, 0]], robots[active[k, 1]]
        if active[k, 3] != 0:
            active[kept] = active[k]
            active[kept, 3] = 0
            kept += 1
        elif active[k, 2] == _NEAR:
            a["near_miss"], b["near_miss"] = a["near_miss"] + 1, b["near_miss"] + 1
            a["near_misses"], b["near_misses"] = a["near_misses"] + 1, b["near_misses"] + 1
    return kept


class FleetFigures:
    """The records ROBOT[1, N] of a fleet, updated moment by moment."""

    def __init__(self, config: EnvConfig) -> None:
        count = config.num_agents
        self.robots: NDArray[Any] = np.zeros((1, count), dtype=ROBOT)
        self.robots["min_gap"] = GAP_HORIZON
        self.robots["held_by"] = self.robots["yields_to"] = -1
        self.moments = -1
        self._config, self._fleet = config, Fleet.of(config)
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
