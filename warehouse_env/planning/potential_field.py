"""The artificial potential field: attraction, repulsion and their resultant on every cell.

Forces are float64[H, W, 2] as (d_row, d_col), the frame of MOVES, so that an angle to a move needs no conversion.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell

_NO_FORCE = 1e-9  # below this a resultant has no direction


def attraction(shape: tuple[int, int], goal: Cell) -> NDArray[np.float64]:
    """Unit vectors float64[H, W, 2] from every cell straight to the goal, zero at the goal."""
    rows, cols = np.indices(shape)
    pull = np.stack([goal[0] - rows, goal[1] - cols], axis=-1).astype(np.float64)
    distance = np.sqrt((pull**2).sum(axis=-1, keepdims=True))
    unit: NDArray[np.float64] = pull / np.maximum(distance, 1.0)
    return unit


def repulsion(occupied: NDArray[np.bool_], gain: float, reach: float) -> NDArray[np.float64]:
    """Sum over the shelf cells closer than `reach` [cells] of gain * (1/d - 1/reach) / d^2, away from each.

    occupied: bool[H, W]. Returns float64[H, W, 2], also on shelf cells. The classical field (Khatib 1986), on whose
    gradient paper 000 builds; the map's edge does not repel.
    """
    rows, cols = occupied.shape
    span = math.ceil(reach) - 1 if reach > 0 else 0
    padded = np.pad(occupied, span)
    push = np.zeros((rows, cols, 2))
    for d_row in range(-span, span + 1):
        for d_col in range(-span, span + 1):
            distance = math.hypot(d_row, d_col)
            if 0 < distance < reach:
                strength = gain * (1 / distance - 1 / reach) / distance**2
                shelf = padded[span + d_row : span + d_row + rows, span + d_col : span + d_col + cols]
                push[..., 0] -= shelf * (strength * d_row / distance)
                push[..., 1] -= shelf * (strength * d_col / distance)
    return push


def resultant(occupied: NDArray[np.bool_], goal: Cell, gain: float, reach: float) -> NDArray[np.float64]:
    """Attraction + repulsion float64[H, W, 2]; where they cancel, the attraction alone (paper 000, after eq. 11)."""
    pull = attraction((occupied.shape[0], occupied.shape[1]), goal)
    force = pull + repulsion(occupied, gain, reach)
    size = np.sqrt((force**2).sum(axis=-1, keepdims=True))
    return np.where(size < _NO_FORCE, pull, force)


def alignment(force: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cosine float64[H, W, 8] of the angle theta between each move and the force float64[H, W, 2]; 0 without force."""
    units = MOVES / np.sqrt((MOVES**2).sum(axis=1, keepdims=True))
    size = np.sqrt((force**2).sum(axis=-1))
    along = force[..., 0, None] * units[:, 0] + force[..., 1, None] * units[:, 1]
    cosine: NDArray[np.float64] = along / np.where(size < _NO_FORCE, 1.0, size)[..., None]
    return cosine
