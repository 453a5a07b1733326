"""What numba-cuda needs to compile the project's functions to the bits of the CPU. The only module that knows it.

Three changes to numba-cuda 0.30 (pinned by the extra `cuda`), since it offers no options for them: rounding and roots
by libdevice, `min` and `max` by comparison as in Python, and no fused multiply-add. Numba only compiles, which needs no
GPU. Machine code is kept on disk, and NVIDIA's cuda.core launches it.
"""

import functools
import hashlib
import importlib.metadata
import math
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from warehouse_env.compiled import digest, kept_file
from warehouse_env.errors import ConfigError, shown

Capability = tuple[int, int]  # compute capability: (9, 0) of the H100 and H200
Driver = Callable[[Any, Any, Any], None]
_BLOCK = 128  # threads of a block at most;
_SPREAD = 132 * 4  # blocks before that, so that few threads, too, use all of a GPU


@functools.cache
def cuda() -> Any:
    """Return the module numba.cuda, changed as said above; ConfigError if numba-cuda is not installed."""
    try:
        import numba_cuda  # noqa: F401  # Numba's own CUDA target is older and lacks what follows
        from numba.cuda import cudaimpl, ufuncs
        from numba.cuda.cudadrv import nvvm
    except ImportError:
        raise ConfigError(
            "kernels for a GPU need numba-cuda, which is not installed: pip install 'warehouse-env[cuda]'"
        ) from None
    from numba import cuda

    _round_by_libdevice(ufuncs.ufunc_db())
    own = cudaimpl.registry.functions
    own[:] = [entry for entry in own if entry[1] not in (min, max)]  # those left compare as Python does
    compile_ir = nvvm.compile_ir
    nvvm.compile_ir = lambda ir, **options: compile_ir(ir, **options | {"fma": False})
    return cuda


def capability_of(text: str) -> Capability:
    """Return a compute capability as "9.0"; ConfigError if the installed compiler makes no code for it."""
    cuda()
    from numba.cuda.cudadrv.nvrtc import get_supported_ccs

    known = {f"{major}.{minor}": (major, minor) for major, minor in get_supported_ccs()}
    if text not in known:
        raise ConfigError(f"kernels are compiled for GPUs of compute capability {', '.join(known)}, not {shown(text)}")
    return known[text]


def check_driver() -> None:
    """ConfigError if the GPU's driver is too old for the machine code."""
    from cuda.bindings.driver import cuDriverGetVersion
    from numba.cuda.cudadrv.runtime import get_version

    (_, known), (needed, _) = cuDriverGetVersion(), get_version()
    if known // 1000 < needed:
        raise ConfigError(f"the GPU's driver is of CUDA {known // 1000}, but kernels need {needed}: update the driver")


class DeviceArray:
    """An array on a device as kernels see it: the memory of a tensor with a shape, strides [B] and a type."""

    def __init__(
        self, memory: Any, shape: Sequence[int], dtype: np.dtype[Any], strides: Sequence[int] | None = None
    ) -> None:
        """Describe a tensor's memory; strides: of C order, which kernels then rely on, unless given."""
        from numba import types
        from numba.np.numpy_support import from_dtype

        self._numba_type_ = types.Array(from_dtype(dtype), len(shape), "C" if strides is None else "A")
        if strides is None:
            strides = [dtype.itemsize * math.prod(shape[axis + 1 :]) for axis in range(len(shape))]
        self.memory = memory  # stays where it is as long as this lives
        self.shape = tuple(shape)
        self.parameters = (0, 0, math.prod(shape), dtype.itemsize, memory.data_ptr(), *shape, *strides)

    def __len__(self) -> int:
        """Return the first axis' length."""
        return self.shape[0]


def compile_ptx(driver: Driver, capability: Capability, *arguments: Any) -> str:
    """Return the PTX of a driver's kernel, of the driver's name, for arguments of these types; needs no GPU."""
    from numba import typeof, types
    from numba.cuda import dispatcher

    module, here = cuda(), dispatcher.get_current_device
    dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=capability)
    try:
        signature = types.void(*map(typeof, arguments))
        how = {"device": False, "cc": capability, "abi": "numba", "output": "ptx"}
        ptx, _ = module.compile(_in_threads(driver), signature, **how)
    finally:
        dispatcher.get_current_device = here
    (name,) = re.findall(r"\.entry\s+([^\s(]+)", ptx)
    return str(ptx.replace(name, driver.__name__))


def machine_code(driver: Driver, capability: Capability, *arguments: Any, note: str = "") -> bytes:
    """Return the machine code of a driver's kernel for arguments of these types: kept on disk, or compiled now.

    note: printed before compiling, which takes up to a minute.
    """
    cuda()
    from numba import typeof
    from numba.cuda.cudadrv.runtime import get_version

    def compile_now() -> bytes:
        from cuda.core import Linker, LinkerOptions, ObjectCode

        begin = time.perf_counter()
        print(note, end="", file=sys.stderr, flush=True)
        ptx = ObjectCode.from_ptx(compile_ptx(driver, capability, *arguments).encode())
        code = Linker(ptx, options=LinkerOptions(arch=f"sm_{capability[0]}{capability[1]}")).link("cubin").code
        print(f"{time.perf_counter() - begin:.0f} s\n" if note else "", end="", file=sys.stderr, flush=True)
        return bytes(code)

    versions = [importlib.metadata.version("numba"), importlib.metadata.version("numba-cuda"), str(get_version())]
    parts = [digest(driver), *versions, Path(__file__).read_text(encoding="utf-8"), *map(str, map(typeof, arguments))]
    key = hashlib.sha256("\n".join(parts).encode()).hexdigest()
    return kept_file(f"{driver.__name__}-{key[:16]}.sm{capability[0]}{capability[1]}.cubin", compile_now)


def launcher(driver: Driver, capability: Capability, threads: int, batch: Any) -> Callable[[int], None]:
    """Return what launches a driver's kernel in so many threads, on a stream given by its handle.

    The batch must stay alive, and the GPU's context be current.
    """
    from cuda.core import LaunchConfig, Stream, launch

    note = f"Compiling the kernel `{driver.__name__}` for this GPU, once: "
    kernel = _loaded(driver.__name__, machine_code(driver, capability, threads, batch, note=note))
    block = min(_BLOCK, max(32, threads // _SPREAD // 32 * 32))
    config = LaunchConfig(grid=-(-threads // block), block=block)
    parameters = tuple(parameters_of((threads, batch)))
    return lambda stream: launch(Stream.from_handle(stream), config, kernel, *parameters)


@functools.cache
def _loaded(name: str, code: bytes) -> Any:
    from cuda.core import ObjectCode

    return ObjectCode.from_cubin(code).get_kernel(name)


def parameters_of(argument: Any) -> Iterator[Any]:
    """Yield a kernel's parameters for an argument, in Numba's order."""
    if isinstance(argument, DeviceArray):
        yield from argument.parameters
    elif isinstance(argument, tuple):
        for part in argument:
            yield from parameters_of(part)
    else:
        yield 0 if argument is None else np.asarray(argument)[()]  # None: a pointer that no code reads


def _round_by_libdevice(known: dict[Any, Any]) -> None:
    """Give numba-cuda np.floor, ceil, rint and sqrt of scalars, each rounded exactly."""
    from llvmlite import ir
    from numba.cuda import cgutils

    def calling(name: str, kind: Any) -> Callable[..., Any]:
        def call(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            found = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, (kind,)), name)
            return builder.call(found, arguments)

        return call

    single, double = ir.FloatType(), ir.DoubleType()
    names = {np.floor: ("floorf", "floor"), np.ceil: ("ceilf", "ceil"), np.rint: ("rintf", "rint")}
    for ufunc, (of_single, of_double) in (names | {np.sqrt: ("fsqrt_rn", "dsqrt_rn")}).items():
        known[ufunc] = {"f->f": calling(f"__nv_{of_single}", single), "d->d": calling(f"__nv_{of_double}", double)}


def _in_threads(driver: Driver) -> Callable[[Any, Any], None]:
    grid = cuda().grid

    def run(threads: Any, batch: Any) -> None:
        thread = grid(1)
        if thread < threads:
            driver(thread, threads, batch)

    return run
