"""Lines simplified to fewer points, by Douglas and Peucker (1973)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel


def simplified(line: NDArray[np.float32], within: float) -> NDArray[np.float32]:
    """Return a line float32[K, 2] [m] with fewer points, its ends among them; dropped ones lie within `within` [m]."""
    if len(line) < 3:
        return line.copy()
    kept: NDArray[np.float32] = line[_needed(line.astype(np.float64), within)]
    return kept


@kernel
def _needed(line, within):
    """Return bool[K], the points of a line float64[K, 2] without which one would lie farther than `within` from it."""
    needed = np.zeros(line.shape[0], np.bool_)
    needed[0] = needed[-1] = True
    left = [(0, line.shape[0] - 1)]  # parts between two points that are needed
    while len(left) > 0:
        first, last = left.pop()
        worst, at = within, -1
        for k in range(first + 1, last):
            beside = _distance(line, k, first, last)
            if beside > worst:
                worst, at = beside, k
        if at >= 0:
            needed[at] = True
            left.append((first, at))
            left.append((at, last))
    return needed


@kernel
def _distance(line, k, first, last):
    """Return how far a point of a line lies from the segment between two others [m]."""
    across, up = line[last, 0] - line[first, 0], line[last, 1] - line[first, 1]
    x, y = line[k, 0] - line[first, 0], line[k, 1] - line[first, 1]
    length = across * across + up * up
    share = min(1.0, max(0.0, (x * across + y * up) / length)) if length > 0 else 0.0
    return np.hypot(x - share * across, y - share * up)
