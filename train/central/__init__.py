"""Central planners read the whole state and map of a Simulator; policies are compared with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from agents.policy import Action
from train.central.pibt import CentralPIBT
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.simulator import Simulator

__all__ = ["CENTRAL", "CentralEntry", "CentralPlanner", "central_config"]


class CentralPlanner(Protocol):
    """Decides for all robots at once from the whole state, and keeps plans between decisions."""

    name: str

    def act_on(self, simulator: Simulator, generators: Sequence[np.random.Generator]) -> Action:
        """Return the next actions of all robots, for `Simulator.step`; random only by the world's generator.

        It may set the robots' routes. A world that has just been reset starts a new plan; worlds are independent.
        """
        ...


@dataclass(frozen=True)
class CentralEntry:
    """One line of the registry: what a planner is, and how to make it."""

    summary: str
    make: Callable[[EnvConfig], CentralPlanner]


CENTRAL: dict[str, CentralEntry] = {
    "central_pibt": CentralEntry("PIBT on the cells, driven in the order of the plan at each cell", CentralPIBT),
}


def central_config(base: EnvConfig) -> EnvConfig:
    """Return `base` with what planners of CENTRAL need: continuous actions and a decision every 0.2 s."""
    return base.replace(action_type="continuous", action_repeat=max(1, round(0.2 / base.time_step)))
