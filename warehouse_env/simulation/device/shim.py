"""What numba-cuda needs to compile the project's functions to the bits of the CPU. The only module that knows it.

Four changes to numba-cuda 0.30 (pinned by the extra `cuda`), since it offers no options for them: rounding and roots by
libdevice, `min` and `max` by comparison as in Python, no fused multiply-add, and None as a kernel's argument.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from warehouse_env.errors import ConfigError

ARCHITECTURE = (9, 0)  # compute capability of the H100 and H200, for which kernels are compiled without a GPU
_MISSING = (
    "device='cuda' needs numba-cuda and a GPU with its driver: {why}; install the extra `cuda` "
    "(pip install 'warehouse-env[cuda]') on a machine with an NVIDIA GPU, or use device='cpu'"
)


@functools.cache
def cuda() -> Any:
    """Return the module numba.cuda, changed as said above; ConfigError if numba-cuda is not installed."""
    try:
        import numba_cuda  # noqa: F401  # Numba's own CUDA target is older and lacks what follows
        from numba.cuda import cudaimpl, dispatcher, ufuncs
        from numba.cuda.cudadrv import nvvm
    except ImportError as missing:
        raise ConfigError(_MISSING.format(why=missing)) from None
    from numba import cuda

    _round_by_libdevice(ufuncs.ufunc_db())
    own = cudaimpl.registry.functions
    own[:] = [entry for entry in own if entry[1] not in (min, max)]  # those left compare as Python does
    compile_ir = nvvm.compile_ir
    nvvm.compile_ir = lambda ir, **options: compile_ir(ir, **options | {"fma": False})
    _pass_none(dispatcher._Kernel)
    return cuda


def check_card() -> None:
    """ConfigError unless there is a GPU that numba-cuda can use."""
    try:
        cuda().current_context()
    except ConfigError:
        raise
    except Exception as failed:  # numba-cuda raises types of its own, which are not public
        raise ConfigError(_MISSING.format(why=str(failed).strip().splitlines()[0])) from None


def compile_ptx(driver: Callable[..., None], *arguments: Any) -> str:
    """Return the PTX of a driver's kernel for arguments of these types, for ARCHITECTURE; needs no GPU."""
    from numba import typeof, types
    from numba.cuda import dispatcher

    here = dispatcher.get_current_device
    dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=ARCHITECTURE)
    try:
        signature = types.void(*map(typeof, arguments))
        how = {"device": False, "cc": ARCHITECTURE, "abi": "numba", "output": "ptx"}
        ptx, _ = cuda().compile(_in_threads(driver), signature, **how)
    finally:
        dispatcher.get_current_device = here
    return str(ptx)


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


def _pass_none(kernel: Any) -> None:
    """Let launches pass None: a null pointer, which no code reads, as its type says all."""
    from numba import types

    prepare = kernel._prepare_args

    def prepare_or_none(self: Any, kind: Any, value: Any, stream: Any, after: Any, arguments: list[Any]) -> None:
        if isinstance(kind, types.NoneType):
            arguments.append(0)
        else:
            prepare(self, kind, value, stream, after, arguments)

    kernel._prepare_args = prepare_or_none


def array_at(flat: Any, shape: Sequence[int], strides: Sequence[int], dtype: np.dtype[Any]) -> Any:
    """Return the memory of a tensor uint8[bytes] on a GPU as numba-cuda's array of a shape, strides [B] and type."""
    from numba.cuda.cudadrv.devicearray import DeviceNDArray

    memory = cuda().as_cuda_array(flat).gpu_data
    return DeviceNDArray(tuple(shape), tuple(strides), dtype, gpu_data=memory)


def kernel_of(driver: Callable[[Any, Any, Any], None]) -> Any:
    """Return the kernel that runs a driver (drivers.py) in so many threads."""
    return cuda().jit(_in_threads(driver))


def _in_threads(driver: Callable[[Any, Any, Any], None]) -> Callable[[Any, Any], None]:
    grid = cuda().grid

    def run(threads: Any, batch: Any) -> None:
        thread = grid(1)
        if thread < threads:
            driver(thread, threads, batch)

    return run
