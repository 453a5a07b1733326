"""Motion primitives of a body: forward and backward arcs, and the time from pose to pose on open floor.

The turning metric is the heuristic of the manoeuvre search (manoeuvre.py): the time from one relative pose to another
without obstacles, found by Dijkstra's algorithm backwards from the goal over the same arcs, and looked up by cell.
Hybrid-state A* (Dolgov et al. 2010) uses Reeds-Shepp lengths, which ignore steering and stopping times.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, kernel
from warehouse_env.simulation.physics.kinematics import curvature
from warehouse_env.simulation.physics.trigonometry import HALF, PI, TWO_PI, ZERO, sin_cos

# lengths are those of the default body, in proportion for longer ones (state.PARAMETERS: long)
STEERS, MOVES = 5, 10  # steering angles; each with forward and backward arcs
LOCK_SHARE = np.float32(0.95)  # of the steering limit: what is left is for feedback
STRIDE = np.float32(0.3)  # [m] of an arc
FORWARD_SPEED, BACKWARD_SPEED = np.float32(0.8), np.float32(0.45)  # [m/s] that arcs are priced by
SHIFT_TIME = np.float32(0.5)  # [s] to stop and begin the other way
STEER_SHARE = np.float32(0.6)  # of the time that steering takes is lost: the rest passes while driving
LENGTH, STEER, BEND, AHEAD, LEFT, COS, SIN, TURN, SECONDS = range(9)  # columns of `moves`

HEADINGS, SIDE = 36, 41  # of the turning metric: cells of 10 degrees, and of CELL [m] each way around the goal
CELL = np.float32(0.2)
_MIDDLE = SIDE // 2
_OPEN_STATES = 16 * HEADINGS * SIDE * SIDE


@inline
def write_moves(stride, p, moves):
    """Write the arcs of `stride` [m] into moves float32[MOVES, 9]: forwards first, from the right lock to the left."""
    for k in range(MOVES):
        lock = LOCK_SHARE * p["max_steer"]
        steer = lock * np.float32(k % STEERS - 2) * HALF
        bend = curvature(steer, p["wheelbase"])
        length = stride if k < STEERS else -stride
        half_s, half_c = sin_cos(HALF * length * bend)
        s, c = sin_cos(length * bend)
        chord = length if k % STEERS == 2 else (half_s + half_s) / bend
        moves[k, LENGTH], moves[k, STEER], moves[k, BEND] = length, steer, bend
        moves[k, AHEAD], moves[k, LEFT] = chord * half_c, chord * half_s
        moves[k, COS], moves[k, SIN], moves[k, TURN] = c, s, length * bend
        moves[k, SECONDS] = stride / (FORWARD_SPEED if k < STEERS else BACKWARD_SPEED)


@inline
def change_time(length, steer, next_length, next_steer, p):
    """Return the seconds lost between two arcs, or between standing (length 0) and an arc."""
    seconds = STEER_SHARE * abs(next_steer - steer) / p["max_steer_rate"]
    return seconds + SHIFT_TIME if length * next_length < ZERO else seconds


@inline
def heading_cell(angle, count):
    """Return which of `count` equal cells an angle of (-3 pi, 3 pi) [rad] lies in, the first around 0."""
    at = int(np.floor(angle * (np.float32(count) / TWO_PI) + HALF))
    return (at + 2 * count) % count


@inline
def seconds_between(ahead, left, turn, turning, cell):
    """Return the turning metric [s] of a pose (ahead, left) [m] in the goal's frame, turned by `turn` [rad] from it.

    cell: the metric's cells [m], CELL for the default body.
    """
    column, row = int(np.floor(ahead / cell + HALF)) + _MIDDLE, int(np.floor(left / cell + HALF)) + _MIDDLE
    near_column, near_row = min(max(column, 0), SIDE - 1), min(max(row, 0), SIDE - 1)
    beyond = np.float32(abs(column - near_column) + abs(row - near_row)) * (cell / FORWARD_SPEED)
    return turning[heading_cell(turn, HEADINGS), near_row, near_column] + beyond


@kernel
def _fill(p, turning):
    """Fill float32[HEADINGS, SIDE, SIDE]: Dijkstra from the origin against the direction of driving."""
    moves = np.empty((MOVES, 9), np.float32)
    cell_size = CELL * p["length_scale"]
    write_moves(STRIDE * p["length_scale"], p, moves)
    turning[...] = np.float32(np.inf)
    poses = np.empty((_OPEN_STATES, 3), np.float32)
    arrived_by = np.empty(_OPEN_STATES, np.int8)
    keys, items = np.empty(_OPEN_STATES, np.float32), np.empty(_OPEN_STATES, np.int32)
    poses[0] = ZERO
    arrived_by[0] = -1
    turning[0, _MIDDLE, _MIDDLE] = ZERO
    size, used = push(keys, items, 0, ZERO, 0), 1
    while size > 0:
        cost, node, size = pop(keys, items, size)
        x, y, heading = poses[node, 0], poses[node, 1], poses[node, 2]
        column, row = int(np.floor(x / cell_size + HALF)) + _MIDDLE, int(np.floor(y / cell_size + HALF)) + _MIDDLE
        if cost > turning[heading_cell(heading, HEADINGS), row, column]:
            continue
        for k in range(MOVES):
            back = moves[(k + STEERS) % MOVES]  # the same arc driven the other way leads to where move k begins
            s, c = sin_cos(heading)
            nx, ny = x + back[AHEAD] * c - back[LEFT] * s, y + back[AHEAD] * s + back[LEFT] * c
            column, row = int(np.floor(nx / cell_size + HALF)) + _MIDDLE, int(np.floor(ny / cell_size + HALF)) + _MIDDLE
            if column < 0 or row < 0 or column >= SIDE or row >= SIDE or used >= _OPEN_STATES:
                continue
            turned = heading + back[TURN]
            turned = turned - TWO_PI if turned > PI else (turned + TWO_PI if turned < -PI else turned)
            total = cost + moves[k, SECONDS]
            if arrived_by[node] >= 0:
                after = arrived_by[node]
                total += change_time(moves[k, LENGTH], moves[k, STEER], moves[after, LENGTH], moves[after, STEER], p)
            cell = heading_cell(turned, HEADINGS)
            if total < turning[cell, row, column]:
                turning[cell, row, column] = total
                poses[used, 0], poses[used, 1], poses[used, 2] = nx, ny, turned
                arrived_by[used] = k
                size = push(keys, items, size, total, used)
                used += 1


@lru_cache(maxsize=8)
def _metrics(values: bytes, dtype: np.dtype[Any]) -> NDArray[np.float32]:
    kinds = np.frombuffer(values, dtype=dtype)
    metrics = np.empty((len(kinds), HEADINGS, SIDE, SIDE), dtype=np.float32)
    for kind, metric in zip(kinds, metrics, strict=True):
        _fill(kind, metric)
        metric[metric == np.inf] = metric[np.isfinite(metric)].max()
    metrics.flags.writeable = False
    return metrics


def turning_metrics(params: NDArray[Any]) -> NDArray[np.float32]:
    """Return float32[K, HEADINGS, SIDE, SIDE] [s] for kinds of robots PARAMETERS[K] (state.py); kept for reuse."""
    kept = np.zeros(len(params), dtype=params.dtype)
    for name in ("wheelbase", "max_steer", "max_steer_rate", "length_scale"):
        kept[name] = params[name]
    return _metrics(kept.tobytes(), kept.dtype)
