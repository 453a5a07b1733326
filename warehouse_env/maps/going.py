"""What going over a floor costs beside its length: limits of speed on cells, and prices of moves.

A move costs its length, times its price, times how much longer it takes than where nothing limits a robot's speed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.errors import MapError, shown

FASTEST, SLOWEST = 1e4, 1e-3  # [m/s]
CHEAPEST, DEAREST = 0.01, 1000.0  # times its length that a lane, and a move, may cost


def checked_speed(speed: ArrayLike | None, occupied: NDArray[np.bool_]) -> NDArray[np.float64] | None:
    """Return a C-ordered float64[H, W] copy [m/s], inf on shelves, None where nothing is limited, or raise MapError."""
    if speed is None:
        return None
    array = _numbers(speed, occupied.shape)
    if array is None or not (array >= SLOWEST).all():
        raise MapError(
            f"speed must hold a number of at least {SLOWEST} [m/s] for each cell of {occupied.shape}, or inf"
        )
    limited = np.where(occupied | (array > FASTEST), np.inf, array)
    return limited if np.isfinite(limited).any() else None


def checked_price(price: ArrayLike | None, occupied: NDArray[np.bool_]) -> NDArray[np.float64] | None:
    """Return a C-ordered float64[H, W, 8] copy, None where all moves cost their length, or raise MapError."""
    if price is None:
        return None
    array = _numbers(price, (*occupied.shape, 8))
    if array is None or not ((array >= 1) & (array <= DEAREST)).all():
        raise MapError(f"price must hold a number from 1 to {DEAREST:g} for each cell of {occupied.shape} and move")
    return array if (array > 1).any() else None


def checked_pace(pace: object) -> float:
    """Return a speed [m/s] as a float, or raise MapError."""
    number = isinstance(pace, (int, float, np.integer, np.floating)) and not isinstance(pace, bool)
    if not (number and SLOWEST <= pace <= FASTEST):  # type: ignore[operator]
        raise MapError(f"pace={shown(pace)} must be a number from {SLOWEST} to {FASTEST:g} [m/s]")
    return float(pace)  # type: ignore[arg-type]


def _numbers(given: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Return a C-ordered float64 copy of numbers of a shape, None where they are something else."""
    try:
        array = np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        return None
    return array if array.shape == shape else None


def surplus(
    speed: NDArray[np.float64] | None, price: NDArray[np.float64] | None, pace: float, moves: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """Return float64[H, W, 8], cells of length that each move costs on top of its own; None: nothing.

    speed: [m/s] at most on cells; price: times the length; pace [m/s]: of robots that nothing limits; moves: MOVES.
    """
    if speed is None and price is None:
        return None
    times = np.ones(8) if price is None else price
    if speed is not None:
        slower = pace / np.minimum(speed, pace)
        rows, columns = slower.shape
        padded = np.pad(slower, 1, constant_values=1.0)
        entered = [padded[1 + r : 1 + r + rows, 1 + c : 1 + c + columns] for r, c in moves.tolist()]
        times = times * 0.5 * (slower[..., None] + np.stack(entered, axis=-1))
    return np.asarray((times - 1.0) * np.hypot(*moves.T))
