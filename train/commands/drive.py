"""What the commands share that drive policies on held-out seeds."""

from __future__ import annotations

from dataclasses import dataclass

from train.learning.config import HELD_OUT_SEED
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError


@dataclass(frozen=True)
class Drive(Checked):
    """Options of worlds to drive in, and what of them is chosen against a policy's own."""

    planner: str = EnvConfig.planner
    """Planner of the routes."""
    protective_field: bool | None = None
    """Refuse commands that could end in a contact (as the policy needs it if left out)."""
    right_of_way: bool | None = None
    """Decide who goes first, and let who is in the way make room (as the policy needs it if left out)."""
    right_of_way_after: float | None = None
    """Let right of way step in only around robots that have stood for so long [s] and wait in a ring, or for five
    times as long, 0: always (as the policy needs it)."""
    reroute: bool | None = None
    """Plan routes anew around robots that stand (as the policy needs it if left out)."""
    people: int | None = None
    """People who walk among the robots; none if left out."""
    seed: int = HELD_OUT_SEED
    """The first seed, the next ones count on; no training uses seeds from the default on."""

    def chosen(self) -> dict[str, bool | float]:
        """Return the fields of EnvConfig that the options set, whatever the policy needs.

        ConfigError where right of way is to step in, and is not to be there.
        """
        options = ("protective_field", "right_of_way", "right_of_way_after", "reroute", "people")
        given = {name: getattr(self, name) for name in options}
        if self.right_of_way_after is not None:
            if self.right_of_way is False:
                after = f"{self.right_of_way_after:g}"
                raise ConfigError(f"--right-of-way-after {after} must be left out with --no-right-of-way")
            given["right_of_way"] = True
        return {name: value for name, value in given.items() if value is not None}
