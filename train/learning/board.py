"""TensorBoard's log of a training: its figures, its evaluations, and what it was trained with, if it is installed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

FIGURES = ("goals_per_robot_hour", "collisions_per_km", "stuck")  # of an evaluation on held-out seeds


class Board:
    """The log of one run, or nothing where TensorBoard is not installed; then `is_open` is False."""

    def __init__(self, directory: Path, settings: Mapping[str, Any], steps: int) -> None:
        """Open it.

        Args:
            directory: of the log.
            settings: of the training by name, for the tab HPARAMS.
            steps: agent-steps done before; what a broken run wrote of later ones is hidden.
        """
        self._writer: Any = None
        try:
            from torch.utils.tensorboard import SummaryWriter
            from torch.utils.tensorboard.summary import hparams
        except ImportError:
            return
        self._writer = SummaryWriter(str(directory), purge_step=steps + 1 if steps else None)
        plain = {name: one if type(one) in (int, float) else str(one) for name, one in settings.items()}
        measured = {f"held_out/{name}": 0.0 for name in FIGURES}  # their values are the scalars of these names
        begin, session, self._end = hparams(plain, measured)  # type: ignore[no-untyped-call]
        for summary in (begin, session):
            self._writer.file_writer.add_summary(summary)

    @property
    def is_open(self) -> bool:
        """Whether there is a log."""
        return self._writer is not None

    def add(self, group: str, figures: Mapping[str, float], steps: int) -> None:
        """Write figures by name, as those of a group after so many agent-steps."""
        if self.is_open:
            for name, value in figures.items():
                self._writer.add_scalar(f"{group}/{name}", value, steps)

    def close(self) -> None:
        """End the log."""
        if self.is_open:
            self._writer.file_writer.add_summary(self._end)
            self._writer.close()
