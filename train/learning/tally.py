"""Counts of what happens in the worlds of a training."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Sequence
from typing import Any

_ENDS = 50  # worlds that ended last, of which the share of jammed ones is told


class TrainingTally:
    """Sums over the agent-steps of some simulators; pairs count once."""

    def __init__(self, simulators: Sequence[Any]) -> None:
        self._simulators, self._sums = simulators, defaultdict[str, Any](float)
        self._ends = deque[bool](maxlen=_ENDS)

    def add(self) -> None:
        """Count the step just made; on a device without waiting for it."""
        sums = self._sums
        for simulator in self._simulators:
            events, (driven, planned) = simulator.fields["events"], simulator.lengths()
            sums["steps"] += simulator.num_worlds * simulator.num_agents
            sums["goals"] += events["arrived"].sum()
            sums["collisions"] += events["hit_robot"].sum() / 2 + events["hit_shelf"].sum() + events["hit_person"].sum()
            sums["metres"] += events["driven"].sum()
            sums["reward"] += simulator.reward.sum()
            sums["driven"] += driven  # [m], for the goals reached
            sums["planned"] += planned  # [m], likewise
            sums["stuck"] += simulator.stuck
            self._ends.extend(simulator.ends)

    def take(self) -> tuple[dict[str, float], list[bool]]:
        """Return the sums since the last call, and whether each of the last worlds that ended had jammed."""
        sums, self._sums = self._sums, defaultdict(float)
        return {name: float(value) for name, value in sums.items()}, list(self._ends)


def figures_of(tallies: Sequence[TrainingTally], decision_seconds: float) -> dict[str, float]:
    """Take the sums of some tallies and return what the progress bar and the log show of them together."""
    sums, ends = defaultdict[str, float](float), list[bool]()
    for taken, last in map(TrainingTally.take, tallies):
        ends += last
        for name, value in taken.items():
            sums[name] += value
    hours, steps = sums["steps"] * decision_seconds / 3600.0, max(sums["steps"], 1)
    return {
        "reward": sums["reward"] / steps,
        "goals_per_robot_hour": sums["goals"] / hours if hours else 0.0,
        "collisions_per_km": 1000.0 * sums["collisions"] / max(sums["metres"], 1.0),
        "path_length_ratio": sums["driven"] / max(sums["planned"], 1.0),
        "stuck": sums["stuck"] / steps,
        "worlds_jammed": sum(ends) / max(len(ends), 1),  # a share of
        "worlds_ended": float(len(ends)),
    }
