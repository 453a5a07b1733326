"""The search for a cheapest way from a robot to its goal, at the prices that other robots set.

A* over (cell, arriving move), by cost and then turns. The heuristic is the exact cost-to-go of the empty floor
(planning/cost_to_go.py). Prices count up to a horizon; beyond it the way follows the cost-to-go. Prices are computed
lazily, and the search ends when no way can cost as little as required, so a robot without obstacles opens few states.
Nothing here grows with the floor except the length of the way.

The arriving move matters only for sharp turns. The states of a cell are closed in the order of their keys, since their
heuristic is the same: after a move that was made without a sharp turn, no later state goes on at less cost.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.heap import pop, push
from warehouse_env.kernel import inline, part
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.planning.cost_to_go import UNREACHABLE
from warehouse_env.planning.graph_search import START, is_hairpin
from warehouse_env.simulation.traffic.prices import is_beyond, next_cell, price_of, rest_from

TURNS = 1 << 20  # turns that a way has less than
_TWICE = 1024  # cells that a way may lead through again, as a long way round instead of a hairpin; ants walk fewer
_QUEUED = 1 << 16  # states that the heap has room for
_ALL = np.uint8(255)
# [9], as bits: the moves that are no hairpin after each, and after none
_ONWARD = np.array([*(sum(1 << (move + turn) % 8 for turn in (-2, -1, 0, 1, 2)) for move in range(8)), 255], np.uint8)


class Labels(NamedTuple):
    """What a search writes, by state = 9 * cell + arriving move; `run` marks what this search wrote."""

    run: NDArray[np.int64]  # [1], how many searches there have been
    at: NDArray[np.int64]  # [S], the search that reached a state; negative once it is closed
    key: NDArray[np.int64]  # [S], cost * TURNS + turns
    before: NDArray[np.int32]  # [S], the state from which it was reached
    left_at: NDArray[np.int64]  # [C], the search that closed a state of a cell
    left: NDArray[np.uint8]  # [C], as bits: the moves that all its closed states make with a hairpin only
    last: NDArray[np.int64]  # [C], the key of the last of them
    keys: NDArray[np.int64]  # [Q] of a heap: bounds ...
    states: NDArray[np.int64]  # [Q] ... and states


def make_path(cells: int) -> NDArray[np.int64]:
    """Return room for the cells (row, column) of a way on a floor of so many, int64[L, 2]."""
    return np.zeros((cells + _TWICE, 2), np.int64)


def make_labels(rows: int, columns: int) -> Labels:
    """Return room for the searches on a floor."""
    cells = rows * columns
    return Labels(
        np.zeros(1, np.int64), np.zeros(9 * cells, np.int64), np.zeros(9 * cells, np.int64),
        np.zeros(9 * cells, np.int32), np.zeros(cells, np.int64), np.zeros(cells, np.uint8), np.zeros(cells, np.int64),
        np.zeros(_QUEUED, np.int64), np.zeros(_QUEUED, np.int64),
    )  # fmt: skip


@inline
def _is_dominated(labels, run, cell, arrived, key):
    """Whether no move from a closed cell gets cheaper by reaching it by move `arrived` with this key.

    With the key of the last closed state it may still save a turn.
    """
    return labels.left_at[cell] == run and key > labels.last[cell] and labels.left[cell] & _ONWARD[arrived] == 0


@inline
def _close(labels, run, cell, arrived, key):
    """Close a state of a cell; return, as bits, the moves to expand."""
    left, moves = _ALL, _ALL
    if labels.left_at[cell] == run:
        left = labels.left[cell]
        if key > labels.last[cell]:
            moves = left & _ONWARD[arrived]
    labels.left_at[cell], labels.left[cell], labels.last[cell] = run, left & ~_ONWARD[arrived], key
    return moves


@part
def search(look, most, labels):
    """Return (state, cost) where the cheapest way reaches the horizon or the goal; (-1, 0) if it costs over `most`."""
    columns, keys, states = look.steps.shape[1], labels.keys, labels.states
    labels.run[0] += 1
    run, start = labels.run[0], 9 * (look.row * columns + look.column) + START
    labels.at[start], labels.key[start], labels.before[start] = run, 0, -1
    size = push(keys, states, 0, 0, start)
    while size > 0:
        _, state, size = pop(keys, states, size)
        if labels.at[state] == -run:
            continue
        cell, arrived = state // 9, state % 9
        row, column = cell // columns, cell % columns
        rest = rest_from(look, row, column)
        if rest == 0 or is_beyond(look, row, column):
            return state, labels.key[state] // TURNS + rest
        labels.at[state] = -run
        moves = _close(labels, run, cell, arrived, labels.key[state])
        for move in range(8):
            step = look.steps[row, column, move]
            if step == 0 or not (moves >> move) & 1:
                continue
            to_row, to_column = row + MOVES[move, 0], column + MOVES[move, 1]
            rest = rest_from(look, to_row, to_column)
            if rest == UNREACHABLE:
                continue
            to = to_row * columns + to_column
            key = labels.key[state] + TURNS * step
            key += TURNS * look.hairpin if is_hairpin(arrived, move) else 0
            if key // TURNS + rest > most:
                continue
            key += TURNS * price_of(look, cell, move, to) + (1 if arrived != START and arrived != move else 0)
            if _is_dominated(labels, run, to, move, key):
                continue
            reached = 9 * to + move
            new = abs(labels.at[reached]) != run
            if key // TURNS + rest > most or size == len(keys) or not (new or key < labels.key[reached]):
                continue
            labels.at[reached], labels.key[reached], labels.before[reached] = run, key, state
            size = push(keys, states, size, key + TURNS * rest, reached)
    return -1, 0


@inline
def lead(look, most, labels, path):
    """Write the cells of a cheapest way up to the horizon to `path`; return (how many, the move to the last one)."""
    state, _ = search(look, most, labels)
    columns, count, back = look.steps.shape[1], 0, state
    while back >= 0:
        count += 1
        back = labels.before[back]
    if count > len(path):
        return 0, START
    back = state
    for k in range(count - 1, -1, -1):
        path[k, 0], path[k, 1] = back // 9 // columns, back // 9 % columns
        back = labels.before[back]
    return count, state % 9


@part
def write_tail(look, count, arrived, path):
    """Extend a way of `count` cells, the last one reached by a move, to the goal; return its number of cells."""
    row, column = path[count - 1, 0], path[count - 1, 1]
    rest = rest_from(look, row, column)
    while rest > 0 and count < len(path):
        arrived = _downhill(look, row, column, rest, 0 if arrived == START else arrived)
        row, column = row + MOVES[arrived, 0], column + MOVES[arrived, 1]
        rest = rest_from(look, row, column)
        path[count, 0], path[count, 1] = row, column
        count += 1
    return count


@part
def write_rest(look, cells, path):
    """Write a robot's cell and the cells still ahead on its route to `path`; return how many.

    cells: int32[L, 2], the cells that its route was made of.
    """
    begin = next_cell(look, cells)
    path[0, 0], path[0, 1] = look.row, look.column
    count = 1
    for k in range(begin, len(cells)):
        if count < len(path) and (cells[k, 0] != path[count - 1, 0] or cells[k, 1] != path[count - 1, 1]):
            path[count, 0], path[count, 1] = cells[k, 0], cells[k, 1]
            count += 1
    return count


@inline
def _downhill(look, row, column, rest, arrived):
    """Return the move with the smallest turn among the cheapest from a cell with cost-to-go `rest`."""
    for k in range(8):
        move = (arrived + ((k + 1) // 2 if k % 2 else -(k // 2))) % 8
        step = look.steps[row, column, move]
        if step > 0:
            there = rest_from(look, row + MOVES[move, 0], column + MOVES[move, 1])
            if there != UNREACHABLE and there + step == rest:
                return move
    return arrived
