"""A table of routes on a device, and the host's part in it: routes that robots want for the first time."""

import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

import torch

from warehouse_env.routes.route_table import Lines, RouteTable
from warehouse_env.simulation.device.memory import Memory, tensor_of

_QUIET = 3.0  # [s] between lines that tell how far the making of routes is


class LinesOnDevice:
    """The copy of a table's arrays on a device. Only what is new in the table travels."""

    def __init__(self, memory: Memory) -> None:
        self._memory, self._tensors = memory, dict[str, torch.Tensor]()
        self._source: Lines | None = None
        self._view: Any = None
        self._count = self._used = 0

    def update(self, table: RouteTable) -> Lines:
        """Bring the copy up to date, and return it as kernels see it: the same tuple until larger arrays are needed."""
        lines, slots, used = table.since(self._count)
        if lines is not self._source:
            lines, slots, used = table.since(0)
            made = {name: self._memory.allocate(array.shape, array.dtype) for name, array in lines._asdict().items()}
            self._tensors = {name: tensor for name, (tensor, _) in made.items()}
            self._view = Lines(**{name: view for name, (_, view) in made.items()})
            self._source, self._count, self._used = lines, 0, 0
        device = self._memory.device
        where = torch.from_numpy(slots).to(device)
        for name, array in lines._asdict().items():
            if name != "points":
                self._tensors[name][where] = tensor_of(array[slots]).to(device)
        self._tensors["points"][self._used : used] = tensor_of(lines.points[self._used : used]).to(device)
        self._count, self._used = self._count + len(slots), used
        return self._view  # type: ignore[no-any-return]


def shown(keys: Sequence[int]) -> Iterator[int]:
    """Yield keys while their routes are made; tell on stderr how far that is, if it takes long."""
    said = time.monotonic()
    for number, key in enumerate(keys):
        yield key
        if time.monotonic() - said > _QUIET:
            said = time.monotonic()
            print(f"made {number + 1:,} of {len(keys):,} routes for the device", file=sys.stderr)
