"""Check the arrays and numbers of a map: read-only copies of the right shape, or a MapError in one sentence."""

import operator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.errors import MapError, shown

T = TypeVar("T", bound=np.generic)

FASTEST, SLOWEST = 1e4, 1e-3  # [m/s]
CHEAPEST, DEAREST = 0.01, 1000.0  # times its length that a lane, and a move, may cost


def frozen(array: NDArray[T]) -> NDArray[T]:
    """Return the array, read-only from now on."""
    array.setflags(write=False)
    return array


def occupied_cells(given: ArrayLike) -> NDArray[np.bool_]:
    """Return a C-ordered bool[H, W] copy with at least one free cell."""
    try:
        array = np.array(given)
    except (TypeError, ValueError):
        raise MapError("occupied has rows of different lengths; all rows must be equally long") from None
    if array.ndim != 2:
        raise MapError(f"occupied must have 2 dimensions (rows, columns), not {array.ndim}")
    if array.size == 0:
        raise MapError(f"the map is empty: occupied has shape {array.shape}")
    if array.dtype != np.bool_ and (array.dtype.kind not in "iuf" or not np.isin(array, (0, 1)).all()):
        raise MapError("occupied must hold only True (shelf) and False (free), or 1 and 0")
    checked = np.ascontiguousarray(array.astype(np.bool_))
    if checked.all():
        raise MapError("the map has no free cell; a robot needs at least one")
    return checked


def numbers(given: ArrayLike, shape: tuple[int, ...], what: str, low: float, high: float) -> NDArray[np.float64]:
    """Return a C-ordered float64 copy of numbers from low to high."""
    try:
        with np.errstate(all="ignore"):  # numbers that signal, or are too large
            array = np.array(np.asarray(given).astype(np.float64, casting="same_kind"), order="C")
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    if array.shape != shape:
        raise MapError(f"{what} must hold a number from {low:g} to {high:g} in each place of an array of shape {shape}")
    wrong = ~((array >= low) & (array <= high))  # nan as well
    if wrong.any():
        at = tuple(np.argwhere(wrong)[0].tolist())
        raise MapError(f"{what} at {at} is {array[at]:g}; it must be from {low:g} to {high:g}")
    return array


def marks_on_floor(given: ArrayLike | None, occupied: NDArray[np.bool_], what: str) -> NDArray[np.bool_] | None:
    """Return a read-only bool[H, W] copy, False on shelves; None where it marks nothing."""
    if given is None:
        return None
    found = flags(given, occupied.shape, what) & ~occupied
    return frozen(found) if found.any() else None


def speed_limits(given: ArrayLike | None, occupied: NDArray[np.bool_]) -> NDArray[np.float64] | None:
    """Return a read-only float64[H, W] copy [m/s], inf on shelves; None where nothing is limited."""
    if given is None:
        return None
    array = numbers(given, occupied.shape, "speed", SLOWEST, np.inf)
    limited = np.where(occupied | (array > FASTEST), np.inf, array)
    return frozen(limited) if np.isfinite(limited).any() else None


def price_factors(given: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Return a read-only float64[H, W, 8] copy; None where all moves cost their length."""
    if given is None:
        return None
    array = numbers(given, (*shape, 8), "price", 1.0, DEAREST)
    return frozen(array) if (array > 1).any() else None


def flags(given: ArrayLike, shape: tuple[int, ...], what: str) -> NDArray[np.bool_]:
    """Return a bool[H, W] copy."""
    array = np.array(given)
    if array.shape != shape or array.dtype != np.bool_:
        raise MapError(f"{what} must hold True or False for each cell of the map's shape {shape}")
    return array


def number(given: object, what: str, low: float, high: float, unit: str = "metres") -> float:
    """Return a number from low to high as a float."""
    plain = isinstance(given, (int, float, np.integer, np.floating)) and not isinstance(given, bool)
    if not (plain and low <= given <= high):  # type: ignore[operator]
        raise MapError(f"{what}={shown(given)} must be a number from {low:g} to {high:g} {unit}")
    return float(given)  # type: ignore[arg-type]


def point(given: Any, what: str, most: float) -> tuple[float, float]:
    """Return two floats within +-most."""
    try:
        x, y = (float(value) for value in given)
    except (TypeError, ValueError, OverflowError):
        x = y = np.nan
    if not (abs(x) <= most and abs(y) <= most):
        raise MapError(f"{what}={shown(given)} must be two numbers of metres up to {most:g}")
    return x, y


def whole_cell(cell: ArrayLike, what: str) -> tuple[int, int]:
    """Return a cell as two Python ints; MapError, beginning with `what`, for anything but two whole numbers."""
    try:
        row, column = (operator.index(number) for number in cell)  # type: ignore[union-attr, arg-type]
    except (TypeError, ValueError):
        raise MapError(f"{what} {shown(cell)} must be two whole numbers (row, column)") from None
    return row, column
