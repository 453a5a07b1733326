"""The artificial potential field: attraction, repulsion and their resultant on every cell.

Forces are float64[H, W, 2] as (d_row, d_col), the frame of MOVES, so that an angle to a move needs no conversion.
Every shelf cell is an obstacle of its own; distances are those between cell centres, in cells.
"""

import math

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES, Cell

_NO_FORCE = 1e-9  # below this a resultant has no direction
_SQRT2 = math.sqrt(2.0)


def repulsion(
    occupied: NDArray[np.bool_], gain: float, reach: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the push of the shelf cells closer than `reach` [cells], float64[H, W, 2], and its potential [H, W].

    Sums of gain * (1/d - 1/reach) / d^2, away from each, and of gain/2 * (1/d - 1/reach)^2, also on shelf cells: the
    classical field (Khatib 1986), on whose gradient paper 000 builds; eq. 5 of paper 001 (which prints it without the
    square that its own gradient, eq. 7, needs), eq. 13 of paper 002. The map's edge does not repel.
    """
    push, energy = np.zeros((*occupied.shape, 2)), np.zeros(occupied.shape)
    rows, cols = occupied.shape
    span = math.ceil(reach) - 1 if reach > 0 else 0
    padded = np.pad(occupied, span)
    for d_row, d_col in np.ndindex(2 * span + 1, 2 * span + 1):
        shelf = padded[d_row : d_row + rows, d_col : d_col + cols]
        offset = np.array([d_row - span, d_col - span])
        distance = math.hypot(*offset)
        if 0 < distance < reach:
            nearness = 1 / distance - 1 / reach
            push -= shelf[..., None] * (gain * nearness / distance**2 * offset / distance)
            energy += shelf * (0.5 * gain * nearness**2)
    return push, energy


def resultant(occupied: NDArray[np.bool_], goal: Cell, gain: float, reach: float) -> NDArray[np.float64]:
    """Attraction + repulsion float64[H, W, 2]; where they cancel, the attraction alone (paper 000, after eq. 11)."""
    straight = np.array(goal) - np.moveaxis(np.indices(occupied.shape), 0, -1)
    pull = straight / np.maximum(np.sqrt((straight**2).sum(axis=-1, keepdims=True)), 1.0)
    force = pull + repulsion(occupied, gain, reach)[0]
    size = np.sqrt((force**2).sum(axis=-1, keepdims=True))
    chosen: NDArray[np.float64] = np.where(size < _NO_FORCE, pull, force)
    return chosen


def alignment(force: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cosine float64[H, W, 8] of the angle theta between each move and the force float64[H, W, 2]; 0 without force."""
    units = MOVES / np.sqrt((MOVES**2).sum(axis=1, keepdims=True))
    size = np.sqrt((force**2).sum(axis=-1))
    along = force[..., 0, None] * units[:, 0] + force[..., 1, None] * units[:, 1]
    cosine: NDArray[np.float64] = along / np.where(size < _NO_FORCE, 1.0, size)[..., None]
    return cosine


@kernel
def force_at(pull_row, pull_col, push_row, push_col, energy, gain, exponent):
    """Force (d_row, d_col) of the improved field on one cell: eqs. 6, 10-12 of paper 001, 12 and 17-20 of paper 002.

    pull: from the cell to the goal [cells], d long; push, energy: `repulsion` there.
    gain * d to the goal + d^n * push + n * energy * d^(n-1) to the goal: the negative gradient of `improved_potential`.
    n = 0 is the classical field. At the goal no force acts.
    """
    distance = math.sqrt(pull_row * pull_row + pull_col * pull_col)
    if distance == 0.0:
        return 0.0, 0.0
    near = distance**exponent
    toward = gain + exponent * energy * near / (distance * distance)
    return toward * pull_row + near * push_row, toward * pull_col + near * push_col


@kernel
def improved_force(push, energy, goal, gain, exponent):
    """`force_at` on every cell, float64[H, W, 2]. push float64[H, W, 2], energy float64[H, W]: `repulsion`."""
    rows, cols = energy.shape
    force = np.empty((rows, cols, 2))
    for row in range(rows):
        for col in range(cols):
            force[row, col] = force_at(
                float(goal[0] - row), float(goal[1] - col), push[row, col, 0], push[row, col, 1], energy[row, col],
                gain, exponent,
            )  # fmt: skip
    return force


def improved_potential(energy: NDArray[np.float64], goal: Cell, gain: float, exponent: float) -> NDArray[np.float64]:
    """gain/2 * d^2 + energy * d^n float64[H, W], d the distance to the goal (eqs. 3, 4 and 9 of paper 001).

    The factor d^n makes the goal the lowest cell, 0, even beside shelves; n = 0 is the classical potential.
    """
    rows, cols = np.indices(energy.shape)
    squared = ((rows - goal[0]) ** 2 + (cols - goal[1]) ** 2).astype(np.float64)
    potential: NDArray[np.float64] = 0.5 * gain * squared + energy * np.sqrt(squared) ** exponent
    return potential


def descent_length(
    potential: NDArray[np.float64], legal: NDArray[np.bool_], goal: Cell, penalty: float
) -> NDArray[np.float64]:
    """Length [cells] of the way down `potential` float64[H, W] from each cell to the goal, float64[H, W].

    Each step is the legal move (bool[H, W, 8]) of steepest descent. A way that ends in a local minimum counts
    `penalty` times the straight distance from there to the goal on top: R_jg of eq. 16, paper 001.
    """
    order = np.argsort(potential, axis=None, kind="stable")
    return np.asarray(_descend(potential, legal, order, goal, penalty))


@kernel
def _descend(potential, legal, order, goal, penalty):
    """`descent_length`, from the lowest cell up, so that the rest of every way is known."""
    cols = potential.shape[1]
    length = np.empty(potential.shape)
    for cell in order:
        row, col = cell // cols, cell % cols
        steepest, best = 0.0, -1
        for move in range(8):
            if legal[row, col, move]:
                fall = potential[row, col] - potential[row + MOVES[move, 0], col + MOVES[move, 1]]
                if move % 2:
                    fall /= _SQRT2
                if fall > steepest:
                    steepest, best = fall, move
        if row == goal[0] and col == goal[1]:
            length[row, col] = 0.0
        elif best < 0:
            length[row, col] = penalty * math.sqrt(float((goal[0] - row) ** 2 + (goal[1] - col) ** 2))
        else:
            step = _SQRT2 if best % 2 else 1.0
            length[row, col] = step + length[row + MOVES[best, 0], col + MOVES[best, 1]]
    return length


def intermediate_point(
    occupied: NDArray[np.bool_], cell: Cell, goal: Cell, tried: NDArray[np.bool_]
) -> tuple[int, int]:
    """Return the intermediate point of a robot stuck on `cell`; (-1, -1) if there is none.

    Paper 002, "local minimum", steps 1-3: through the obstacle goes a perpendicular to the line from the robot to the
    goal; the free cell on it that is nearest to the obstacle, on either side, is the point P. The obstacle is the
    first shelf cell that bars the line, else the nearest. Cells of `tried` bool[H, W] and the robot's own are
    skipped, so a robot that is stuck again gets another point.
    """
    shelf, shelves = _blocking_shelf(occupied, cell, goal), np.argwhere(occupied)
    size = max(abs(goal[0] - cell[0]), abs(goal[1] - cell[1]))
    rows, cols = occupied.shape
    if not len(shelves) or size == 0:
        return -1, -1
    if shelf[0] < 0:
        shelf = shelves[((shelves - cell) ** 2).sum(axis=1).argmin()]
    for away in range(1, max(rows, cols)):
        for side in (away, -away):
            row = int(shelf[0]) + math.floor(side * (cell[1] - goal[1]) / size + 0.5)
            col = int(shelf[1]) + math.floor(side * (goal[0] - cell[0]) / size + 0.5)
            if not (0 <= row < rows and 0 <= col < cols) or occupied[row, col] or tried[row, col]:
                continue
            if row != cell[0] or col != cell[1]:
                return row, col
    return -1, -1


@kernel
def _blocking_shelf(occupied, cell, goal):
    """The first shelf cell on the straight line from `cell` to `goal`, or that a diagonal of it would graze."""
    span = max(abs(goal[0] - cell[0]), abs(goal[1] - cell[1]))
    row, col = cell
    for step in range(1, span + 1):
        to_row = cell[0] + int(math.floor((goal[0] - cell[0]) * step / span + 0.5))
        to_col = cell[1] + int(math.floor((goal[1] - cell[1]) * step / span + 0.5))
        for at_row, at_col in ((to_row, to_col), (to_row, col), (row, to_col)):
            if occupied[at_row, at_col]:
                return at_row, at_col
        row, col = to_row, to_col
    return -1, -1
