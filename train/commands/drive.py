"""What the commands share that drive policies on held-out seeds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from train.learning.config import HELD_OUT_SEED
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig


@dataclass(frozen=True)
class Drive(Checked):
    """Options of worlds to drive in, and `env`, their configuration."""

    planner: str = EnvConfig.planner
    """Planner of the routes."""
    protective_field: bool = EnvConfig.protective_field
    """Refuse commands that could end in a contact."""
    right_of_way: bool = EnvConfig.right_of_way
    """Decide who goes first, and let who is in the way make room."""
    reroute: bool = EnvConfig.reroute
    """Plan routes anew around robots that stand."""
    seed: int = HELD_OUT_SEED
    """The first seed, the next ones count on; no training uses seeds from the default on."""

    def env(self, **changes: Any) -> EnvConfig:
        """Return the configuration that the options ask for, with changes."""
        return EnvConfig(
            planner=self.planner, protective_field=self.protective_field, right_of_way=self.right_of_way,
            reroute=self.reroute, **changes,
        )  # fmt: skip
