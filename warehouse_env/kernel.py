"""Decorators that compile kernels: no fastmath, so that results are the same bits on every path.

`kernel` compiles a function that Python calls, or that makes arrays. `part` and `inline` compile functions that only
kernels call, into these kernels alone (linked.py). Such functions neither make nor return arrays, so they do not count
references (`_nrt`): that takes an atomic operation for each array passed, several times the cost of a short function.
`inline` also removes the call.

Numba compiles a function again, with all that it calls, for each width of whole numbers and for constants. Where one
caller passes 0 and another an int32 from an array, both pass `whole(...)`. That saves a quarter of compiling.
"""

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
    made = _njit(**_OPTIONS, _nrt=True)(function)  # explicit; otherwise it would inherit its caller's
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
    """Return the compiled code of a kernel for the types of these arguments, which it does not check.

    A kernel finds the types of 18 arguments in 3 us at each call, a quarter of the time of eight robots' step.
    """
    if not hasattr(kernel, "compile"):  # NUMBA_DISABLE_JIT
        return kernel
    code: Callable[..., Any] = kernel.compile(tuple(map(kernel.typeof_pyval, arguments)))  # type: ignore[attr-defined]
    return code
