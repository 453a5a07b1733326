"""Counts of what happens in the worlds of a training."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

_ENDS = 50  # worlds that ended last, of which the share of jammed ones is told


@dataclass
class Counts:
    """Sums over agent-steps; pairs count once."""

    steps: float = 0.0
    goals: float = 0.0
    collisions: float = 0.0
    metres: float = 0.0
    driven: float = 0.0  # [m], for the goals reached
    planned: float = 0.0  # [m], likewise
    reward: float = 0.0
    stuck: float = 0.0
    ends: tuple[bool, ...] = ()  # of the last worlds that ended, whether each had jammed

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def figures(self, decision_seconds: float) -> dict[str, float]:
        """Return what the progress bar and the log show."""
        hours = self.steps * decision_seconds / 3600.0
        return {
            "reward": self.reward / max(self.steps, 1),
            "goals_per_robot_hour": self.goals / hours if hours else 0.0,
            "collisions_per_km": 1000.0 * self.collisions / max(self.metres, 1.0),
            "path_length_ratio": self.driven / max(self.planned, 1.0),
            "stuck": self.stuck / max(self.steps, 1),
            "worlds_jammed": sum(self.ends) / max(len(self.ends), 1),  # a share of
            "worlds_ended": float(len(self.ends)),
        }


class TrainingTally:
    """Counts what happens in some simulators."""

    def __init__(self, simulators: Sequence[Any]) -> None:
        self._simulators = simulators
        self._counts = Counts()
        self._ends = deque[bool](maxlen=_ENDS)

    def add(self) -> None:
        """Count the step just made; on a device without waiting for it."""
        counts = self._counts
        for simulator in self._simulators:
            events = simulator.fields["events"]
            counts.steps += simulator.num_worlds * simulator.num_agents
            counts.goals += events["arrived"].sum()
            counts.collisions += events["hit_robot"].sum() / 2 + events["hit_shelf"].sum() + events["hit_person"].sum()
            counts.metres += events["driven"].sum()
            counts.reward += simulator.reward.sum()
            driven, planned = simulator.lengths()
            counts.driven += driven
            counts.planned += planned
            counts.stuck += simulator.stuck
            self._ends.extend(simulator.ends)

    def take(self) -> Counts:
        """Return the counts since the last call, and start again from 0."""
        *sums, _ = astuple(self._counts)
        self._counts = Counts()
        taken = Counts(*map(float, sums))  # type: ignore[arg-type]
        taken.ends = tuple(self._ends)  # few end between two calls, so the last ones of before count again
        return taken
