"""Memory and launches of a device: torch tensors that kernels see as arrays of the types that they have on the CPU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from warehouse_env.simulation import state
from warehouse_env.simulation.device import shim

Bundle = TypeVar("Bundle")
Driver = Callable[[Any, Any, Any], None]
_BLOCK = 128  # threads of a block


def mapped(bundle: Bundle, change: Callable[[NDArray[Any]], Any]) -> Bundle:
    """Return nested tuples with each array replaced; one array in several places stays one."""
    changed: dict[int, Any] = {}

    def visit(one: Any) -> Any:
        if isinstance(one, np.ndarray):
            if id(one) not in changed:
                changed[id(one)] = change(one)
            return changed[id(one)]
        if isinstance(one, tuple):
            parts = map(visit, one)
            return type(one)(*parts) if hasattr(one, "_fields") else tuple(parts)
        return one

    made: Bundle = visit(bundle)
    return made


class Memory:
    """Memory of the CPU. Drivers run one after another; everything but the hardware is as on a GPU."""

    device = torch.device("cpu")

    def allocate(self, shape: Sequence[int], dtype: np.dtype[Any]) -> tuple[torch.Tensor, Any]:
        """Return zeros as a tensor, and the same memory as kernels see it. A record is uint8[..., its bytes]."""
        flat = torch.zeros(max(int(np.prod(shape)) * dtype.itemsize, 1), dtype=torch.uint8, device=self.device)
        return _typed(flat, shape, dtype), self._view(flat, shape, dtype)

    def _view(self, flat: torch.Tensor, shape: Sequence[int], dtype: np.dtype[Any]) -> Any:
        count = int(np.prod(shape)) * dtype.itemsize
        return flat.numpy()[:count].view(dtype).reshape(shape)

    def constant(self, array: NDArray[Any]) -> Any:
        """Return an array that never changes, as kernels see it."""
        return array

    def scratch(self, threads: int, array: NDArray[Any]) -> Any:
        """Return [threads, ...] arrays like this one, as kernels see them."""
        return np.zeros((threads, *array.shape), array.dtype)

    def launch(self, driver: Driver, threads: int, batch: Any) -> None:
        """Call a driver for each thread."""
        for thread in range(threads):
            driver(thread, threads, batch)

    def threads(self, most: int) -> int:
        """Return how many threads run a kernel, of which a GPU takes `most`."""
        return 1


class CompilerMemory(Memory):
    """Memory of the CPU laid out as on a GPU, for which kernels are compiled without one."""

    def constant(self, array: NDArray[Any]) -> Any:
        return array.copy()

    def scratch(self, threads: int, array: NDArray[Any]) -> Any:
        return np.moveaxis(np.zeros((*array.shape, threads), array.dtype), -1, 0)

    def threads(self, most: int) -> int:
        return most


class CardMemory(Memory):
    """Memory of a GPU. Launches join torch's current stream, so they keep the order of torch's own work."""

    def __init__(self, device: torch.device) -> None:
        """ConfigError without numba-cuda, or a GPU that it can use."""
        shim.check_card()
        self.device = device
        self._kernels: dict[Driver, Any] = {}

    def _view(self, flat: torch.Tensor, shape: Sequence[int], dtype: np.dtype[Any]) -> Any:
        return shim.array_at(flat, shape, np.empty(shape, dtype).strides, dtype)

    def constant(self, array: NDArray[Any]) -> Any:
        tensor, view = self.allocate(array.shape, array.dtype)
        tensor.copy_(tensor_of(array))
        return view

    def scratch(self, threads: int, array: NDArray[Any]) -> Any:
        """Neighbouring threads' elements lie side by side, so that a warp reads them at once."""
        dtype, shape = array.dtype, (threads, *array.shape)
        flat = torch.empty(max(int(np.prod(shape)) * dtype.itemsize, 1), dtype=torch.uint8, device=self.device)
        strides = (dtype.itemsize, *(threads * stride for stride in array.strides))
        return shim.array_at(flat, shape, strides, dtype)

    def launch(self, driver: Driver, threads: int, batch: Any) -> None:
        if driver not in self._kernels:
            self._kernels[driver] = shim.kernel_of(driver)
        stream = torch.cuda.current_stream(self.device).cuda_stream
        self._kernels[driver][-(-threads // _BLOCK), _BLOCK, shim.cuda().external_stream(stream)](threads, batch)

    def threads(self, most: int) -> int:
        return most


def memory_of(device: str) -> Memory:
    """Return the memory of a device by torch's name of it; ConfigError if it cannot be used."""
    if device == "compiler":
        return CompilerMemory()
    place = torch.device(device)
    return Memory() if place.type == "cpu" else CardMemory(place)


def tensor_of(array: NDArray[Any]) -> torch.Tensor:
    """Return a tensor with the content of an array; a record is uint8[..., its bytes], uint64 the int64 of its bits."""
    whole = np.ascontiguousarray(array)
    if whole.dtype == np.uint64:  # for which torch has no index_copy_
        whole = whole.view(np.int64)
    if whole.dtype.fields:
        whole = whole.view(np.uint8).reshape(*array.shape, array.dtype.itemsize)
    return torch.from_numpy(whole.copy())


def field_on_device(records: torch.Tensor, name: str) -> torch.Tensor:
    """Return the view of a field of ROBOT records uint8[..., bytes], in whichever record it is (`state.field_of`)."""
    record, begin = dict(state.ROBOT.fields or {})[state.OWNER[name]][:2]
    dtype, offset = dict(record.fields or {})[name][:2]
    return records.view(tensor_of(np.empty(0, dtype)).dtype)[..., (begin + offset) // dtype.itemsize]


def _typed(flat: torch.Tensor, shape: Sequence[int], dtype: np.dtype[Any]) -> torch.Tensor:
    count = int(np.prod(shape)) * dtype.itemsize
    if dtype.fields:
        return flat[:count].view(*shape, dtype.itemsize)
    return flat[:count].view(tensor_of(np.empty(0, dtype)).dtype).view(*shape)
