"""How every kernel is compiled: no fastmath, so that results are the same bits on every path.

`kernel` is called from Python, or makes arrays. `part` and `inline` are called by kernels and work on what they are
given: they neither make nor return arrays, so they need not count references to them (`_nrt`), which takes an atomic
operation for each array passed, several times what a short function costs otherwise. `inline` also has no call.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

_Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]
_compiled: Any = numba.njit  # whose stubs leave `_nrt` out
_EACH = {"cache": True, "error_model": "numpy", "nogil": True}

kernel: _Decorator = _compiled(**_EACH, _nrt=True)  # said, or it would take over its caller's
part: _Decorator = _compiled(**_EACH, _nrt=False)
inline: _Decorator = _compiled(**_EACH, forceinline=True, _nrt=False)
