"""`warehouse compile`: compile all kernels ahead of time."""

import os
import time
from dataclasses import dataclass, field
from typing import ClassVar

from train.evaluation.kernels import compile_all
from train.reporting.report import Table, number
from warehouse_env.checked import Checked


@dataclass(frozen=True)
class Compile(Checked):
    """Compile all kernels in several processes and keep them on disk.

    Once is enough for each version of the source and each kind of processor; later, kernels are only loaded.
    """

    processes: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Number of processes."""
    cuda: tuple[str, ...] | None = None
    """Also compile the kernels for GPUs of these compute capabilities, which needs no GPU. Without a value: that of
    this machine's GPU, or 9.0 (H100, H200)."""
    ranges: ClassVar = {"processes": (1, 4096)}

    def run(self) -> None:
        """Compile, and print how long each part took."""
        capabilities = self._capabilities()
        begin = time.perf_counter()
        rows = compile_all(self.processes, capabilities)
        cells = tuple((row["part"], number(row["seconds"])) for row in rows)
        note = f"All is compiled and kept: {time.perf_counter() - begin:.0f} s in {self.processes} processes."
        Table("Kernels", ("part", "seconds"), cells, note).print()

    def _capabilities(self) -> tuple[str, ...]:
        """Return the compute capabilities to compile for; ConfigError for one that is none."""
        if self.cuda is None:
            return ()
        from warehouse_env.simulation.device.memory import capability_at_hand, memory_of

        chosen = self.cuda or (capability_at_hand(),)
        for capability in chosen:
            memory_of(f"compiler:{capability}")
        return chosen
