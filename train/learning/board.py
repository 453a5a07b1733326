"""TensorBoard's log of a training: its figures, its evaluations, and what it was trained with, if it is installed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

FIGURES = ("goals_per_robot_hour", "collisions_per_km", "stuck")  # of an evaluation on held-out seeds


class Board:
    """The log of one run; nothing is written where TensorBoard is not installed, and `is_open` is False."""

    def __init__(self, directory: Path, settings: Mapping[str, Any], steps: int) -> None:
        """Open the log in `directory`, and write the settings of the training as a text.

        steps: agent-steps done before; what a broken run wrote of later ones is hidden.
        """
        self._writer: Any = None
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            return
        self._writer = SummaryWriter(str(directory), purge_step=steps + 1 if steps else None)
        self._writer.add_text("settings", "".join(f"- {name}: {value}\n" for name, value in settings.items()))

    @property
    def is_open(self) -> bool:
        """Whether there is a log."""
        return self._writer is not None

    def add(self, group: str, figures: Mapping[str, float], steps: int) -> None:
        """Write the figures of a group after `steps` agent-steps."""
        if self.is_open:
            for name, value in figures.items():
                self._writer.add_scalar(f"{group}/{name}", value, steps)

    def close(self) -> None:
        """End the log."""
        if self.is_open:
            self._writer.close()
