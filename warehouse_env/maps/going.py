"""Speed limits on cells and prices of moves: what a move costs beside its length.

A move costs its length, times its price, times how much longer it takes than without speed limits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.maps.moves import MOVES, beyond
from warehouse_env.maps.tables import frozen, numbers

FASTEST, SLOWEST = 1e4, 1e-3  # [m/s]
CHEAPEST, DEAREST = 0.01, 1000.0  # times its length that a lane, and a move, may cost


def checked_speed(speed: ArrayLike | None, occupied: NDArray[np.bool_]) -> NDArray[np.float64] | None:
    """Return a read-only float64[H, W] copy [m/s], inf on shelves; None where nothing is limited."""
    if speed is None:
        return None
    array = numbers(speed, occupied.shape, "speed", SLOWEST, np.inf)
    limited = np.where(occupied | (array > FASTEST), np.inf, array)
    return frozen(limited) if np.isfinite(limited).any() else None


def checked_price(price: ArrayLike | None, occupied: NDArray[np.bool_]) -> NDArray[np.float64] | None:
    """Return a read-only float64[H, W, 8] copy; None where all moves cost their length."""
    if price is None:
        return None
    array = numbers(price, (*occupied.shape, 8), "price", 1.0, DEAREST)
    return frozen(array) if (array > 1).any() else None


def surplus(
    speed: NDArray[np.float64] | None, price: NDArray[np.float64] | None, pace: float
) -> NDArray[np.float64] | None:
    """Return float64[H, W, 8], cells of length that each move costs on top of its own; None: nothing.

    speed: [m/s] at most on cells; price: times the length; pace [m/s]: of robots that nothing limits.
    """
    if speed is None and price is None:
        return None
    times = np.ones(8) if price is None else price
    if speed is not None:
        slower = pace / np.minimum(speed, pace)
        times = times * 0.5 * (slower[..., None] + beyond(slower, 1.0))
    return np.asarray((times - 1.0) * np.hypot(*MOVES.T))
