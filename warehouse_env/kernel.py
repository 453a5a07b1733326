"""How every kernel is compiled: no fastmath, so that results are the same bits on every path."""

from __future__ import annotations

import numba

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)
inline = numba.njit(cache=True, error_model="numpy", forceinline=True)
