"""How every kernel is compiled: no fastmath, so that results are the same bits on every path.

`kernel` is called from Python, or makes arrays. `part` and `inline` are called by kernels and work on what they are
given: they neither make nor return arrays, so they need not count references to them (`_nrt`), which takes an atomic
operation for each array passed, several times what a short function costs otherwise. `inline` also has no call.

Numba compiles a function again, with all that it calls, for a whole number of another width and for a constant. So
callers say `whole(...)` where one would give the number 0 and another an int32 out of an array: a quarter of compiling.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numba
import numpy as np

from warehouse_env.compiled import source_digest

Function = TypeVar("Function", bound=Callable[..., Any])


class _Decorator(Protocol):
    def __call__(self, function: Function, /) -> Function:
        """Return what calls the compiled function."""


_njit: Any = numba.njit  # whose stubs leave `_nrt` out
_UNKEPT = (
    "compiled kernels cannot be kept, so every start compiles them anew, for minutes: name a folder that can be "
    "written in NUMBA_CACHE_DIR"
)


def _folder_in(chosen: str) -> str:
    """Return the folder for kernels of this source in the one that the user chose; empty if none was."""
    return chosen and str(Path(chosen) / f"warehouse-{source_digest(Path(__file__).parent)[:16]}")


FOLDER = _folder_in(numba.config.CACHE_DIR)  # type: ignore[attr-defined]
"""Where kernels are kept; empty: beside the source."""


@contextlib.contextmanager
def _kept_apart() -> Iterator[None]:
    """Have Numba keep what is defined within in a folder of this version's own, where the user chose a folder."""
    chosen: str = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = FOLDER  # type: ignore[attr-defined]
    try:
        yield
    finally:
        numba.config.CACHE_DIR = chosen  # type: ignore[attr-defined]


def _compiled(**options: bool) -> _Decorator:
    """Return a decorator that compiles, and keeps what is compiled where any folder for it can be written."""
    each = {**options, "error_model": "numpy", "nogil": True}

    def decorate(function: Function) -> Function:
        try:
            with _kept_apart():
                return _njit(**each, cache=True)(function)  # type: ignore[no-any-return]
        except RuntimeError:  # Numba's, where neither the package's folder nor the user's can be written
            warnings.warn(_UNKEPT, RuntimeWarning, stacklevel=1)  # once, for all have this line
            return _njit(**each)(function)  # type: ignore[no-any-return]

    return decorate


kernel: _Decorator = _compiled(_nrt=True)  # said, or it would take over its caller's
part: _Decorator = _compiled(_nrt=False)
inline: _Decorator = _compiled(forceinline=True, _nrt=False)

whole: Any = np.int64  # see above


def compiled_for(kernel: Callable[..., Any], *arguments: Any) -> Callable[..., Any]:
    """Return the compiled code of a kernel for arguments of the types of these, which it takes for granted.

    To find out the types of 18 arguments takes a kernel 3 us at each call, a quarter of what eight robots' step takes.
    """
    if not hasattr(kernel, "compile"):  # NUMBA_DISABLE_JIT
        return kernel
    code: Callable[..., Any] = kernel.compile(tuple(map(kernel.typeof_pyval, arguments)))  # type: ignore[attr-defined]
    return code
