"""`Audit`, a watcher that keeps the faults of the robots it watches."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from train.evaluation.audit import instants
from train.evaluation.audit.arcs import STATE
from train.evaluation.audit.bodies import AuditFleet
from train.evaluation.audit.instants import HORIZON, KINDS, LIMITS, OVERLAPS
from train.reporting.rows import Row
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.simulator import Simulator

MOST_REPEAT = 2  # most physics steps of an env step that its ends determine
_ROOM = 256  # most faults of a step that are kept


class _Looks(NamedTuple):
    """The state of all worlds at an instant."""

    states: NDArray[np.float64]  # [B, N, STATE]
    alive: NDArray[np.bool_]  # [B, N]
    people: NDArray[np.float64]  # [B, M, 2]

    @classmethod
    def at(cls, simulator: Simulator) -> Self:
        """Copy the state."""
        robots, persons = simulator.robots, simulator.people.persons
        states = np.empty((*robots.shape, STATE))
        for column, name in enumerate(("x", "y", "heading", "speed", "steer")):
            states[..., column] = robots["motion"][name]
        people = np.stack([persons["x"], persons["y"]], axis=-1).astype(np.float64)
        return cls(states, robots["task"]["alive"] != 0, people)


def solid_of(grid: GridMap) -> NDArray[np.bool_]:
    """Return bool[W, H]: the shelves by columns and rows of cells, counted from x = y = 0."""
    rows, columns = grid.shape
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5, indexing="ij")
    cells = grid.cell(np.stack([x, y], axis=-1) * grid.cell_size)
    return np.ascontiguousarray(grid.walls[cells[..., 0], cells[..., 1]])


class Audit:
    """A watcher of a simulator (see rollout.Watcher) that keeps the faults of each world."""

    def __init__(self, config: EnvConfig) -> None:
        """Raises ConfigError for env steps of too many physics steps."""
        if config.action_repeat > MOST_REPEAT:
            raise ConfigError(
                f"action_repeat={config.action_repeat} must be at most {MOST_REPEAT} for an audit: of longer steps the "
                "motion between their ends cannot be told"
            )
        self._config, self._fleet = config, AuditFleet.of(config)
        self._step_time = config.time_step * config.action_repeat
        self._last: _Looks | None = None
        self._steps = 0
        self.found: list[list[Row]] = []  # faults of each world

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Check what happened since the last call."""
        now = _Looks.at(simulator)
        if self._last is None:
            self._begin(simulator, now)
        else:
            self._check(self._last, now, simulator.events.touching != 0)
        self._last, self._steps = now, steps

    def _begin(self, simulator: Simulator, now: _Looks) -> None:
        worlds = len(now.states)
        grid, faults = simulator.grid, np.empty((_ROOM, instants.FAULT))
        self._obstacles = instants.Obstacles(solid_of(grid), grid.discs.astype(np.float64), float(grid.cell_size))
        self._findings = instants.Findings(np.full(worlds, HORIZON), np.zeros(worlds), faults)
        self.found = [[] for _ in range(worlds)]

    def _check(self, before: _Looks, after: _Looks, touching: NDArray[np.bool_]) -> None:
        """Check a step. Robots that park or are put back by a contact are known only at its ends."""
        parked = before.alive & ~after.alive & (not self._config.traffic_spec.shield)
        walked = (after.people - before.people) / self._step_time
        self._look(before, after, touching | parked, walked)

    def _look(self, before: _Looks, after: _Looks, put_back: NDArray[np.bool_], walked: NDArray[np.float64]) -> None:
        step = instants.EnvStep(before.states, after.states, put_back, before.people, walked)
        count = instants.audit_step(step, self._obstacles, self._fleet, self._findings)
        for fault in self._findings.faults[:count].tolist():
            self._keep(fault)

    def _keep(self, fault: Sequence[float]) -> None:
        """Keep a fault; it continues a fault of the last step between the same two."""
        world, kind, robot, other, time, size, x, y = fault
        known = self.found[int(world)]
        who = {"robot": int(robot), "other": None if other == instants.NONE else int(other)}
        what = {"kind": KINDS[int(kind)], **who}
        for old in reversed(known):
            if old["last_step"] < self._steps - 1:
                break
            if old.items() >= what.items():
                old["last_step"], old["size"] = self._steps, max(old["size"], size)
                return
        when = {"step": self._steps, "last_step": self._steps, "time": time}
        known.append({**what, **when, "size": size, "x": x, "y": y})

    def rows(self) -> list[Row]:
        """Check the end of the last step, and return the figures of each world."""
        if self._last is not None:
            still = np.zeros_like(self._last.people)
            self._look(self._last, self._last, np.ones_like(self._last.alive), still)
        return [self._row(world) for world in range(len(self.found))]

    def _row(self, world: int) -> Row:
        found, closest = self.found[world], float(self._findings.closest[world])
        kinds = Counter(fault["kind"] for fault in found)
        return {
            "steps": self._steps, "robot_km": float(self._findings.ways[world]) / 1000,
            **{f"overlaps_{kind}": kinds[kind] for kind in OVERLAPS},
            "limits": sum(kinds[kind] for kind in LIMITS), "jumps": kinds["jump"],
            "deepest_m": max((fault["size"] for fault in found if fault["kind"] in OVERLAPS), default=0.0),
            "closest_m": max(closest, 0.0) if closest < HORIZON else None,
            "faults": found,
        }  # fmt: skip
