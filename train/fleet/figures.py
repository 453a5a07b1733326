"""Figures of a fleet from its poses, counted like the simulator's: metres, standing, near misses, contacts, goals."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.evaluation.audit.bodies import AuditBody, Outline, gap
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.state import GAP_HORIZON, ROBOT
from warehouse_env.simulation.traffic.waits import SLOW

PRESENT, LOADED, AT_ROBOT, AT_SHELF, AT_PERSON, UNDER_WAY, SILENT = 1, 2, 4, 8, 16, 32, 64
"""Bits of a vehicle at a moment: it is present, carries something, touches something, has to drive, is silent."""
MOMENT = np.dtype(
    [
        ("bits", np.uint8),
        ("goal", np.int32),  # row * columns + column of the cell
        ("line", np.int32),  # which of the lines of the orders
        ("goals", np.int32),  # reached so far
        ("planned", np.float32),  # [m] to them
    ]
)
_STANDS_WITHIN = 1.0  # [m]

Pair = tuple[int, int]


class FleetFigures:
    """The records ROBOT[1, N] of a fleet, updated moment by moment."""

    def __init__(self, config: EnvConfig) -> None:
        self.robots: NDArray[Any] = np.zeros((1, config.num_agents), dtype=ROBOT)
        self.robots["totals"]["min_gap"] = GAP_HORIZON
        self.robots["shield"]["vetoed_by"] = self.robots["traffic"]["yields_to"] = -1
        self.moments = -1
        self._config, self._body = config, AuditBody.of(config, config.robot)
        self._active: dict[Pair, bool] = {}  # pairs that are near, and whether they have touched
        self._pose: NDArray[np.float64] | None = None
        self._was: NDArray[Any] | None = None

    def seconds(self, world: int = 0) -> float:
        """Return the time since the first moment [s]."""
        return self.moments * self._config.time_step

    def take(self, pose: NDArray[np.float32], moment: NDArray[Any]) -> None:
        """Take the next moment: pose float32[N, 3], moment MOMENT[N]."""
        self.moments += 1
        now = pose.astype(np.float64)
        before, was = (now, moment) if self._pose is None or self._was is None else (self._pose, self._was)
        self._move(now, before, (moment["bits"] & was["bits"] & PRESENT) != 0)
        self._touch(moment["bits"], was["bits"])
        self._stand((moment["bits"] & (PRESENT | UNDER_WAY)) == PRESENT | UNDER_WAY)
        self._arrive(moment["goals"] - was["goals"], moment["planned"])
        way = self.robots[0]["on_route"]["position"]
        way[moment["line"] != was["line"]] = 0.0
        self._look_at_pairs(moment["bits"])
        self._pose, self._was = now, moment

    def _move(self, now: NDArray[np.float64], before: NDArray[np.float64], seen: NDArray[np.bool_]) -> None:
        """Take the poses [N, 3] of this moment and the last; seen: whether a vehicle was present at both."""
        robots = self.robots[0]
        motion, heading = robots["motion"], now[:, 2]
        motion["x"], motion["y"], motion["heading"] = now.T
        motion["cos"], motion["sin"] = np.cos(heading), np.sin(heading)
        (dx, dy), last = (now - before)[:, :2].T, before[:, 2]
        way = np.where(seen, np.hypot(dx, dy), 0.0)
        ahead = dx * (motion["cos"] + np.cos(last)) + dy * (motion["sin"] + np.sin(last))
        motion["speed"] = np.where(ahead >= 0, way, -way) / self._config.time_step
        robots["totals"]["distance"] += way
        robots["on_route"]["position"] += way

    def _touch(self, bits: NDArray[np.uint8], was: NDArray[np.uint8]) -> None:
        """Begin contacts with shelves and people as they are told, and forget the last moment's events."""
        events, totals = self.robots[0]["events"], self.robots[0]["totals"]
        for name in ("arrived", "hit_robot", "near_miss"):
            events[name] = 0
        events["gap"] = GAP_HORIZON
        events["touching"] = (bits & (AT_ROBOT | AT_SHELF | AT_PERSON)) != 0
        for other, bit in (("shelf", AT_SHELF), ("person", AT_PERSON)):
            events[f"hit_{other}"] = (bits & ~was & bit) != 0
            totals[f"hits_{other}"] += events[f"hit_{other}"]

    def _stand(self, alive: NDArray[np.bool_]) -> None:
        """Count how long vehicles stand, wait and drive to one goal."""
        robots, dt = self.robots[0], self._config.time_step if self.moments else 0.0
        motion, task, totals, clocks = robots["motion"], robots["task"], robots["totals"], robots["clocks"]
        begins = (task["alive"] == 0) & alive
        task["acting"], task["alive"] = task["alive"], alive
        moved = np.hypot(motion["x"] - clocks["anchor_x"], motion["y"] - clocks["anchor_y"]) > _STANDS_WITHIN
        anew = moved | begins | (self.moments == 0)
        for axis in "xy":
            clocks[f"anchor_{axis}"] = np.where(anew, motion[axis], clocks[f"anchor_{axis}"])
        clocks["standing_time"] = np.where(anew, 0.0, clocks["standing_time"] + dt * alive)
        clocks["stalled_time"] = clocks["standing_time"]
        totals["longest_standing"] = np.maximum(totals["longest_standing"], clocks["standing_time"])
        if self.moments:
            totals["lived"] += alive
            totals["waited"] += alive & (np.abs(motion["speed"]) < SLOW)
            task["age"] += alive

    def _arrive(self, reached: NDArray[np.int32], planned: NDArray[np.float32]) -> None:
        """Count the goals that vehicles have `reached` since the last moment."""
        robots, late = self.robots[0], self.moments > self._config.max_steps // 2
        task, totals = robots["task"], robots["totals"]
        for i in np.flatnonzero(reached > 0).tolist():
            robots["events"]["arrived"][i] = 1
            totals["goals"][i] += reached[i]
            totals["late_goals"][i] += reached[i] * late
            totals["longest_age"][i], task["age"][i] = max(totals["longest_age"][i], task["age"][i]), 0
            totals["planned"][i] = planned[i]
            totals["driven_to_goals"][i] += totals["distance"][i] - totals["distance_at_goal"][i]
            totals["distance_at_goal"][i], totals["finish_time"][i] = totals["distance"][i], self.seconds()

    def _look_at_pairs(self, bits: NDArray[np.uint8]) -> None:
        """Begin and end near misses and contacts of pairs; of pairs that end, those that never touched are near misses.

        A pair touches if its bodies overlap, or both report to touch a robot.
        """
        robots, near = self.robots[0], self._config.near_miss_gap
        events, totals, last = robots["events"], robots["totals"], self._active
        self._active = {}
        for pair, found in self._gaps():
            both = list(pair)
            told = np.bitwise_and.reduce(bits[both])
            if not told & PRESENT:
                continue
            touch = found < 0 or bool(found < near and told & AT_ROBOT)
            for values in (events["gap"], totals["min_gap"]):
                values[both] = np.minimum(values[both], 0.0 if touch else found)
            if touch and not last.get(pair):
                events["hit_robot"][both] += 1
                totals["hits_robot"][both] += 1
            if touch:
                events["touching"][both] = 1
            if touch or found < near:
                self._active[pair] = touch or last.get(pair, False)
        for pair in [pair for pair, touched in last.items() if not touched and pair not in self._active]:
            events["near_miss"][list(pair)] += 1
            totals["near_misses"][list(pair)] += 1

    def _gaps(self) -> Iterator[tuple[Pair, float]]:
        """Yield all pairs nearer than GAP_HORIZON, and perhaps others, with the gap of their bodies [m]."""
        from scipy.spatial import cKDTree  # not when this is loaded, which takes long

        motion, body, apart = self.robots[0]["motion"], self._body, 2.0 * self._body.radius + GAP_HORIZON
        turned = np.stack([motion["cos"], motion["sin"]], axis=-1).astype(np.float64)
        centres = np.stack([motion["x"], motion["y"]], axis=-1).astype(np.float64) - body.back * turned
        both = np.hstack([centres, turned]).tolist()
        outlines = [Outline(x, y, c, s, body.half_length, body.half_width) for x, y, c, s in both]
        for i, j in sorted(cKDTree(centres).query_pairs(apart)):
            yield (i, j), gap(outlines[i], outlines[j])
