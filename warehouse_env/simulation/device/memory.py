"""Memory and launches of a device: torch tensors that kernels see as arrays of the types that they have on the CPU."""

import math
import os
import re
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError, shown
from warehouse_env.simulation import state
from warehouse_env.simulation.device import shim
from warehouse_env.simulation.device.shim import Driver

Bundle = TypeVar("Bundle")


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


def bytes_of(bundle: Any) -> int:
    """Return the bytes of all arrays in nested tuples."""
    sizes: list[int] = []
    mapped(bundle, lambda array: sizes.append(array.nbytes))
    return sum(sizes)


class Memory:
    """Memory of the CPU. Drivers run one after another; everything but the hardware is as on a GPU."""

    device = torch.device("cpu")

    def allocate(self, shape: Sequence[int], dtype: np.dtype[Any]) -> tuple[torch.Tensor, Any]:
        """Return zeros as a tensor, and the same memory as kernels see it; ConfigError if there is too little.

        A tensor of records is uint8[..., their bytes], and one of uint64 is int64, which torch copies everywhere.
        """
        try:
            flat = torch.zeros(max(math.prod(shape) * dtype.itemsize, 1), dtype=torch.uint8, device=self.device)
        except RuntimeError as failed:
            raise ConfigError(f"{self.device} has too little memory for so many worlds; use fewer: {failed}") from None
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


class CardMemory(Memory):
    """Memory of a GPU. Launches join torch's current stream, so they keep the order of torch's own work."""

    def __init__(self, device: torch.device, capability: shim.Capability) -> None:
        """Lay memory out for kernels of GPUs of this compute capability."""
        self.device, self._capability = device, capability
        self._launchers: dict[Driver, tuple[Any, Callable[[int], None]]] = {}  # and the batches that they are for

    def _view(self, flat: torch.Tensor, shape: Sequence[int], dtype: np.dtype[Any]) -> Any:
        return shim.DeviceArray(flat, shape, dtype)

    def constant(self, array: NDArray[Any]) -> Any:
        tensor, view = self.allocate(array.shape, array.dtype)
        tensor.copy_(tensor_of(array))
        return view

    def scratch(self, threads: int, array: NDArray[Any]) -> Any:
        """Neighbouring threads' elements lie side by side, so that a warp reads them at once.

        Elements of a thread are an odd number of warps apart: by a power of two, they would share few lines of a cache.
        """
        dtype, shape, apart = array.dtype, (threads, *array.shape), (-(-threads // 32) | 1) * 32
        flat = torch.empty(max(apart * array.nbytes, 1), dtype=torch.uint8, device=self.device)
        strides = (dtype.itemsize, *(apart * stride for stride in array.strides))
        return shim.DeviceArray(flat, shape, dtype, strides)

    def launch(self, driver: Driver, threads: int, batch: Any) -> None:
        made_for, call = self._launchers.get(driver, (None, None))
        with torch.cuda.device(self.device):
            if call is None or made_for is not batch:
                call = shim.launcher(driver, self._capability, threads, batch)
                self._launchers[driver] = (batch, call)
            call(torch.cuda.current_stream().cuda_stream)

    def threads(self, most: int) -> int:
        return most


class CompilerMemory(CardMemory):
    """Memory of the CPU, for which kernels are compiled as for a GPU of its layout, but not run."""

    def __init__(self, capability: shim.Capability) -> None:
        """Lay memory out for kernels of GPUs of this compute capability."""
        super().__init__(torch.device("cpu"), capability)

    def launch(self, driver: Driver, threads: int, batch: Any) -> None:
        """Keep the kernel on disk."""
        shim.machine_code(driver, self._capability, threads, batch)


def memory_of(device: str) -> Memory:
    """Return the memory of a device by torch's name of it; ConfigError if it cannot be used.

    "compiler:9.0" compiles kernels for GPUs of that compute capability, and runs none.
    """
    kind, _, number = str(device).partition(":")
    if kind == "compiler":
        return CompilerMemory(shim.capability_of(number))
    if kind not in ("cpu", "cuda") or not re.fullmatch(r"\d{0,3}", number):
        raise ConfigError(f"device {shown(device)} must be 'cpu', 'cuda' for a GPU, or 'cuda:1' for a further one")
    if kind == "cpu":
        return Memory()
    place = find_card(number)
    return CardMemory(place, shim.capability_of(capability_at_hand(place)))


def capability_at_hand(card: torch.device | None = None) -> str:
    """Return the compute capability of a GPU, else of torch's current one; "9.0" (H100, H200) if there is none."""
    return "{}.{}".format(*torch.cuda.get_device_capability(card)) if torch.cuda.is_available() else "9.0"


def find_card(number: str = "") -> torch.device:
    """Return a GPU by torch's number of it, "" for torch's current one; ConfigError says what is missing to use it."""
    os.environ.setdefault("CUDA_DEVICE_MAX_CONNECTIONS", "32")  # streams that run side by side; read as CUDA starts
    shim.cuda()
    count, why = torch.cuda.device_count(), ""
    if torch.version.cuda is None:
        why = f"PyTorch is installed without CUDA ({torch.__version__}): install its CUDA build"
    elif count == 0:
        why = "PyTorch finds no GPU: `nvidia-smi` shows whether there is one with a driver"
    elif int(number or 0) >= count:
        why = f"there is no GPU cuda:{number}: the last one is cuda:{count - 1}"
    if why:
        raise ConfigError(f"{why}, or use device='cpu'")
    shim.check_driver()
    return torch.device("cuda", int(number) if number else torch.cuda.current_device())


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
