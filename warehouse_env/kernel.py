"""How every kernel is compiled: no fastmath, so that results are the same bits on every path.

`kernel` is called from Python, or makes arrays. `part` and `inline` are called by kernels, and compiled into these
alone (linked.py). They work on what they are given: they neither make nor return arrays, so they need not count
references to them (`_nrt`), which takes an atomic operation for each array passed, several times what a short function
costs otherwise. `inline` also has no call.

Numba compiles a function again, with all that it calls, for a whole number of another width and for a constant. So
callers say `whole(...)` where one would give the number 0 and another an int32 out of an array: a quarter of compiling.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import numba
import numpy as np

from warehouse_env.compiled import KernelCache
from warehouse_env.linked import OPTIONS as LINKED
from warehouse_env.linked import LinkedCacheImpl, LinkedCompiler

Function = TypeVar("Function", bound=Callable[..., Any])


class _Decorator(Protocol):
    def __call__(self, function: Function, /) -> Function:
        """Return what calls the compiled function."""


_njit: Any = numba.njit  # whose stubs leave `_nrt` out


_OPTIONS = {"error_model": "numpy", "nogil": True}


def kernel(function: Function, /) -> Function:
    """Compile a function, and keep what is compiled (compiled.py)."""
    made = _njit(**_OPTIONS, _nrt=True)(function)  # said, or it would take over its caller's
    if hasattr(made, "py_func"):  # not under NUMBA_DISABLE_JIT
        made._cache = KernelCache(made)
    return made  # type: ignore[no-any-return]


def _linked(**options: bool) -> _Decorator:
    """Return a decorator that compiles a function into the kernels that call it (linked.py)."""

    def decorate(function: Function) -> Function:
        made = _njit(**_OPTIONS, **options, _nrt=False, pipeline_class=LinkedCompiler, **LINKED)(function)
        if not hasattr(made, "py_func"):
            return made  # type: ignore[no-any-return]
        made._cache = KernelCache(made, LinkedCacheImpl)
        alone: Any = kernel(function)
        made._insert = lambda *_: None  # so Numba asks the next line what to call, at every call from Python
        made._compile_for_args = lambda *_: alone
        return made  # type: ignore[no-any-return]

    return decorate


part: _Decorator = _linked()
inline: _Decorator = _linked(forceinline=True)

whole: Any = np.int64  # see above


def compiled_for(kernel: Callable[..., Any], *arguments: Any) -> Callable[..., Any]:
    """Return the compiled code of a kernel for arguments of the types of these, which it takes for granted.

    To find out the types of 18 arguments takes a kernel 3 us at each call, a quarter of what eight robots' step takes.
    """
    if not hasattr(kernel, "compile"):  # NUMBA_DISABLE_JIT
        return kernel
    code: Callable[..., Any] = kernel.compile(tuple(map(kernel.typeof_pyval, arguments)))  # type: ignore[attr-defined]
    return code
