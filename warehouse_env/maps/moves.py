"""The 8 moves of eq. 26 (paper 000): what lies beyond each, which are legal, and what they cost."""

from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps import one_way as arrows

T = TypeVar("T", bound=np.generic)

# As (d_row, d_col), counter-clockwise from east; odd indices are diagonal.
MOVES: NDArray[np.int64] = np.array(
    [(0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1)], dtype=np.int64
)


def shifted(values: NDArray[T], d_row: int, d_column: int, rim: Literal["constant", "edge"] = "constant") -> NDArray[T]:
    """Return [H, W]: the value `d_row` rows and `d_column` columns (-1, 0 or 1) off each cell; rim: np.pad's mode."""
    rows, columns = values.shape
    padded = np.pad(values, 1, mode=rim)
    return padded[1 + d_row : 1 + d_row + rows, 1 + d_column : 1 + d_column + columns]


def beyond(values: NDArray[T], outside: Any = 0) -> NDArray[T]:
    """Return [H, W, 8]: the value [H, W] of the cell that each of MOVES leads to."""
    rows, columns = values.shape
    padded = np.pad(values, 1, constant_values=outside)
    return np.stack([padded[1 + r : 1 + r + rows, 1 + c : 1 + c + columns] for r, c in MOVES.tolist()], axis=-1)


def reversed_moves(moves: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return bool[H, W, 8]: what `moves` says of the opposite move on the cell beyond; False outside."""
    return np.stack([shifted(moves[..., (m + 4) % 8], r, c) for m, (r, c) in enumerate(MOVES.tolist())], axis=-1)


def label_regions(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return int32[H, W]: 0 outside the mask, else the number (from 1, in reading order) of the 4-connected region.

    For free cells these are also the regions of eq. 26: its diagonals need both orthogonal cells free.
    """
    from scipy import ndimage  # imported late: it takes long

    labels: NDArray[np.int32] = ndimage.label(mask)[0]
    return labels


def legal_moves(
    occupied: NDArray[np.bool_], one_way: NDArray[np.uint8], tight: NDArray[np.bool_] | None
) -> NDArray[np.bool_]:
    """Return bool[H, W, 8]; see `GridMap.legal_moves`."""
    free = beyond(~occupied)
    legal = free & ~occupied[..., None]
    for m in range(1, 8, 2):
        legal[..., m] &= free[..., m - 1] & free[..., (m + 1) % 8]
    if one_way.any():
        against = arrows.against(one_way)
        # a move that leaves a cell enters the next one from the other side of the opposite move
        legal &= ~against & ~reversed_moves(np.roll(against, 4, axis=2))
    return legal if tight is None else legal & _leads_off(legal, tight)


def surplus(
    speed: NDArray[np.float64] | None, price: NDArray[np.float64] | None, pace: float
) -> NDArray[np.float64] | None:
    """Return float64[H, W, 8], cells of length that each move costs on top of its own; None: nothing.

    A move costs its length, times its price, times how much longer it takes than without speed limits.

    speed: [m/s] at most on cells; price: times the length; pace [m/s]: of robots that nothing limits.
    """
    if speed is None and price is None:
        return None
    times = np.ones(8) if price is None else price
    if speed is not None:
        slower = pace / np.minimum(speed, pace)
        times = times * 0.5 * (slower[..., None] + beyond(slower, 1.0))
    return np.asarray((times - 1.0) * np.hypot(*MOVES.T))


def _leads_off(legal: NDArray[np.bool_], tight: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return bool[H, W, 8]: moves that enter no tight cell, or lead to a tight cell nearer to floor that is not."""
    far = np.pad(np.where(tight, np.inf, 0.0), 1)  # tight cells up to floor that is not, this one counted
    able = np.pad(legal & tight[..., None], ((1, 1), (1, 1), (0, 0)))
    last = np.argwhere(~tight) + 1
    while len(last):
        found = []
        for move, way in enumerate(MOVES):
            before = last - way
            before = before[able[*before.T, move] & np.isinf(far[*before.T])]
            far[*before.T] = far[*(before + way).T] + 1.0
            found.append(before)
        last = np.concatenate(found)
    here = far[1:-1, 1:-1]
    there = beyond(here)
    return np.asarray((there < here[..., None]) | (there == 0.0) | np.isinf(here[..., None]))
