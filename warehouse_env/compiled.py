"""Compiled kernels on disk, each under a digest of all that went into it.

Numba by itself stores a kernel beside its source and notices changes of that file only, although a kernel contains the
code of every function that it calls. Here a kernel's name on disk ends in a digest of its own code, of the code of all
kernels that it calls, and of the constants that they use. So kernels are never stale, several versions share a folder,
and an edit compiles only what depends on it. A read-only folder is read.
"""

import contextlib
import functools
import hashlib
import os
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple, Self

import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache, NullCache
from numba.core.dispatcher import Dispatcher
from platformdirs import user_cache_dir

_UNUSED_DAYS = 30  # after which a kept kernel is removed
_UNKEPT = (
    "compiled kernels cannot be kept in {folder}, so every start compiles them again, for minutes: "
    "name a folder that can be written in NUMBA_CACHE_DIR"
)


def kernels_folder() -> Path:
    """Return the folder of kept kernels: in NUMBA_CACHE_DIR if that is set, else in the user's cache folder."""
    chosen: str = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    return Path(chosen or user_cache_dir("warehouse_env"), "kernels")


def kept_file(name: str, make: Callable[[], bytes]) -> bytes:
    """Return the content of a file in the folder of kept kernels, made and stored if it is missing."""
    file = kernels_folder() / name
    with contextlib.suppress(OSError):
        return file.read_bytes()
    made, part = make(), file.with_name(f"{os.getpid()}-{name}")
    _remove_unused(str(file.parent))
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(made)
        part.replace(file)
    except OSError:
        _warn_once(str(file.parent))
    return made


class KernelCache(NullCache):
    """Numba's cache of one kernel, looked up at the first call, because its callees may be defined after it."""

    def __init__(self, dispatcher: Any, reading: type[CompileResultCacheImpl] = CompileResultCacheImpl) -> None:
        self._dispatcher, self._reading = dispatcher, reading

    @functools.cached_property
    def _kept(self) -> Any:
        return _KeptKernel(self._dispatcher, self._reading)

    @property
    def cache_path(self) -> str:
        """The folder."""
        return str(kernels_folder())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code for a signature; None if none is stored, or it names types that no longer exist."""
        with contextlib.suppress(OSError, AttributeError, ImportError):
            return self._kept.load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compiled code for a signature, where the folder can be written."""
        try:
            _remove_unused(self.cache_path)
            try:
                self._kept.save_overload(sig, data)
            except (AttributeError, ImportError):  # stored for tuples of types that no longer exist
                self._kept.flush()
                self._kept.save_overload(sig, data)
        except OSError:
            _warn_once(self.cache_path)


class _KeptKernel(FunctionCache):
    """Numba's own reading and writing of compiled code, in our folder and under our names."""

    def __init__(self, dispatcher: Any, reading: type[CompileResultCacheImpl]) -> None:
        ours = {"_locator_classes": [_Locator(dispatcher)]}
        self._impl_class = type("Named", (reading,), ours)  # type: ignore[assignment]
        super().__init__(dispatcher.py_func)  # type: ignore[no-untyped-call]


class _Locator:
    """Numba's view of the folder: where a kernel is kept and what its name ends in."""

    def __init__(self, dispatcher: Any) -> None:
        self._digest = digest(dispatcher)
        self._py_file = dispatcher.py_func.__code__.co_filename  # which Numba names in warnings

    def from_function(self, py_func: object, py_file: str) -> Self:
        """Return this locator, which is made for one function."""
        return self

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(kernels_folder())

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        os.makedirs(self.get_cache_path(), exist_ok=True)

    def get_source_stamp(self) -> str:
        """Return the digest, by which Numba tells versions apart."""
        return self._digest

    def get_disambiguator(self) -> str:
        """Return what sets the kernel's files apart from those of its other versions."""
        return self._digest[:16]


@functools.cache
def _warn_once(folder: str) -> None:
    warnings.warn(_UNKEPT.format(folder=folder), RuntimeWarning, stacklevel=2)


@functools.cache  # once in a process
def _remove_unused(folder: str) -> None:
    """Remove kernels that were not loaded for `_UNUSED_DAYS`."""
    before = time.time() - 86400 * _UNUSED_DAYS
    for file in (*Path(folder).glob("*.nb[ic]"), *Path(folder).glob("*.cubin")):
        with contextlib.suppress(OSError):
            about = file.stat()
            if max(about.st_atime, about.st_mtime) < before:
                file.unlink()


class _Own(NamedTuple):
    """A function's own code as a digest, and the functions of ours that it calls."""

    digest: bytes
    calls: tuple[Any, ...]


def digest(kernel: Any) -> str:
    """Return a digest of all that a kernel is compiled from: 64 hexadecimal digits, the same in any folder.

    A kernel is a Dispatcher of Numba's, or a plain function that is compiled into others.
    """
    found, waiting = {}, [kernel]
    while waiting:
        one = waiting.pop()
        if one not in found:
            found[one] = _own(one)
            waiting += found[one].calls
    flags = f"{numba.config.BOUNDSCHECK} {numba.config.OPT} {np.__version__}"  # type: ignore[attr-defined]
    parts = [flags.encode(), found[kernel].digest, *sorted(own.digest for own in found.values())]
    return hashlib.sha256(b"".join(parts)).hexdigest()


@functools.cache
def _own(kernel: Any) -> _Own:
    function: FunctionType = getattr(kernel, "py_func", kernel)
    codes = list(_codes(function.__code__))
    names = {name for code in codes for name in code.co_names}
    values = {name: value for name, value in function.__globals__.items() if name in names}
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    values |= {name: cell.cell_contents for name, cell in cells}
    ours = function.__module__.partition(".")[0], "warehouse_env"  # versions of Numba and NumPy count apart
    for module in [one for one in values.values() if isinstance(one, ModuleType) and one.__name__.startswith(ours)]:
        values |= {f"{module.__name__}.{name}": vars(module)[name] for name in names & vars(module).keys()}
    calls = {name: value for name, value in values.items() if _is_compiled(value, ours)}
    said = [f"{function.__module__}.{function.__qualname__} {sorted(getattr(kernel, 'targetoptions', {}).items())}"]
    for code in codes:
        constants = [one for one in code.co_consts if not isinstance(one, CodeType) and one != function.__doc__]
        said.append(f"{code.co_code.hex()} {code.co_names} {code.co_varnames} {constants}")
    said += [f"{name}={_text(value)}" for name, value in sorted(values.items()) if name not in calls]
    for name, one in sorted(calls.items()):
        callee = getattr(one, "py_func", one)
        said.append(f"{name}={callee.__module__}.{callee.__qualname__}")
    return _Own(hashlib.sha256("\n".join(said).encode()).digest(), tuple(calls.values()))


def _is_compiled(value: Any, ours: tuple[str, ...]) -> bool:
    plain = isinstance(value, FunctionType) and value.__module__.startswith(ours)
    return plain or isinstance(value, Dispatcher)


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield a function's code and that of the functions within."""
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _codes(inner)


def is_kept(kernel: Any) -> bool:
    """Return whether compiled code of this version of a kernel is on disk, for any signature."""
    return any(kernels_folder().glob(f"*-{digest(kernel)[:16]}.*.nbi"))


def _text(value: Any) -> str:
    """Return a constant, as it is compiled in, as text."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype.descr} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, (tuple, list)):
        return f"({', '.join(map(_text, value))})"
    if callable(value) or isinstance(value, ModuleType):  # a type, a module, a function of NumPy's
        return f"{getattr(value, '__module__', '')}.{value.__name__} {getattr(value, '_fields', '')}"
    return f"{type(value).__name__} {value!r}"
