"""Central planners: they read a Simulator's whole state and map. No policies, but what those are held against."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from agents.policy import Action
from train.central.pibt import CentralPIBT
from warehouse_env.config import ActionType, EnvConfig
from warehouse_env.simulation.simulator import Simulator

__all__ = ["CENTRAL", "CentralEntry", "CentralPlanner", "central_config"]


class CentralPlanner(Protocol):
    """Decides for all robots at once, from all that the simulator knows; keeps plans between its decisions."""

    name: str

    def act_on(self, simulator: Simulator, generators: Sequence[np.random.Generator]) -> Action:
        """Return the next actions of all robots, as `Simulator.step` takes them; chance only from a world's generator.

        It may set the robots' routes. A world that has just been reset begins anew; worlds do not know of each other.
        """
        ...


@dataclass(frozen=True)
class CentralEntry:
    """One line of the registry: how a planner is made, and the actions that it drives with."""

    summary: str
    make: Callable[[EnvConfig], CentralPlanner]
    action_type: ActionType


CENTRAL: dict[str, CentralEntry] = {
    "central_pibt": CentralEntry("PIBT on the cells, driven in the plan's order at each", CentralPIBT, "continuous"),
}


def central_config(name: str, base: EnvConfig) -> EnvConfig:
    """Return `base` with what the planner of CENTRAL needs put in: its action type, a decision every 0.2 s."""
    return base.replace(action_type=CENTRAL[name].action_type, action_repeat=max(1, round(0.2 / base.time_step)))
