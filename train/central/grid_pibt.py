"""PIBT on the grid of cells for robots with a heading: one synchronous step, and the metric that it descends.

A robot's place is a cell and a heading, 0 to 3 counter-clockwise from east. In a step it stays, drives into the cell
ahead, to its left or to its right (and turns that way), or backs into the cell behind. No two robots share a cell or
swap cells, and no closed cycle of robots moves at once, for which bodies have no room.

Source: Okumura, Machida, Defago, Tamura 2022, "Priority inheritance with backtracking for iterative multi-agent path
finding". Adapted: places have headings, so that cheap moves are those of a car-like body; cycles are refused.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel

AHEAD, ASIDE, BEHIND = 2, 3, 8  # costs of moves, half-cells of driving ahead: aside it slows down, behind it backs
FAR = np.int32(2**30)
BACKWARDS = 4  # added to the heading of a move in reverse
_STEPS = np.array([(0, 1), (-1, 0), (0, -1), (1, 0)], dtype=np.int64)  # (d_row, d_col) of headings 0..3


class Choosing(NamedTuple):
    """The input of one step of PIBT for N robots, and its choices so far."""

    cell: Any  # int64[N]
    heading: Any  # int64[N]
    costs: Any  # int32[N, 4, H * W], see cost_to_go
    noise: Any  # float64[N, 5]
    blocked: Any  # bool[H, W]
    occupant: Any  # int64[H * W], the robot on a cell, or -1
    taken: Any  # int64[H * W], the robot that a cell is kept for, or -1
    chosen: Any  # int64[N], the next cell, -1 while undecided
    moves: Any  # int64[N]


@kernel
def neighbour(cell, heading, blocked):
    """Return the cell next to `cell` in a direction, or -1 if there is none; blocked: bool[H, W]."""
    columns = blocked.shape[1]
    row, column = cell // columns + _STEPS[heading, 0], cell % columns + _STEPS[heading, 1]
    if row < 0 or column < 0 or row >= blocked.shape[0] or column >= columns or blocked[row, column]:
        return -1
    return row * columns + column


@kernel
def cost_to_go(blocked: NDArray[np.bool_], goal: int) -> NDArray[np.int32]:
    """Return int32[4, H * W], the least cost from (heading, cell) to the goal cell; FAR: unreachable.

    Label setting with buckets (Dial 1969), backwards from the goal in any heading.
    """
    size = blocked.size
    cost = np.full((4, size), FAR, np.int32)
    lists = np.empty((BEHIND + 1, 8 * size), np.int64)
    counts = np.zeros(BEHIND + 1, np.int64)
    for heading in range(4):
        cost[heading, goal] = 0
        lists[0, heading] = goal * 4 + heading
    counts[0] = 4
    level, left = 0, 4
    while left > 0:
        now = level % (BEHIND + 1)
        for k in range(counts[now]):
            cell, heading = lists[now, k] // 4, lists[now, k] % 4
            if cost[heading, cell] < level:
                continue
            for turn in range(4):  # 0: it came from behind, 1 and 3: and turned into this heading, 2: it backed
                way = heading if turn == 2 else (heading + 2) % 4
                before = neighbour(cell, way, blocked)
                source = heading if turn == 2 else (heading + turn) % 4
                price = BEHIND if turn == 2 else AHEAD if turn == 0 else ASIDE
                if before >= 0 and level + price < cost[source, before]:
                    cost[source, before] = level + price
                    target = (level + price) % (BEHIND + 1)
                    lists[target, counts[target]] = before * 4 + source
                    counts[target] += 1
                    left += 1
        left -= counts[now]
        counts[now] = 0
        level += 1
    return cost


@kernel
def _choices(i, cell, heading, cost, noise, blocked, targets, moves):
    """Write the robot's possible next cells and moves, best first; return their number."""
    keys = np.empty(5, np.float64)
    count = 0
    for turn in range(5):
        if turn == 4:
            target, move, key = cell[i], heading[i], float(cost[heading[i], cell[i]]) + 0.5
        elif turn == 2:
            target, move = neighbour(cell[i], (heading[i] + 2) % 4, blocked), heading[i] + BACKWARDS
            key = 0.0 if target < 0 else float(cost[heading[i], target] + BEHIND - AHEAD)
        else:
            way = (heading[i] + turn) % 4
            target, move = neighbour(cell[i], way, blocked), way
            key = 0.0 if target < 0 else float(cost[way, target] + (AHEAD if turn == 0 else ASIDE) - AHEAD)
        if target < 0:
            continue
        key += noise[i, turn]
        k = count
        while k > 0 and keys[k - 1] > key:
            keys[k], targets[k], moves[k] = keys[k - 1], targets[k - 1], moves[k - 1]
            k -= 1
        keys[k], targets[k], moves[k] = key, target, move
        count += 1
    return count


@kernel
def _closes_a_ring(i, target, cell, chosen, occupant):
    """Return whether robot i would close a cycle of moving robots by driving into `target`."""
    at = target
    while True:
        j = occupant[at]
        if j < 0 or j == i or chosen[j] < 0 or chosen[j] == cell[j]:
            return False
        at = chosen[j]
        if at == cell[i]:
            return True


@kernel
def _decide(i, step):
    """Choose robot i's next cell; an undecided robot there chooses first. Return False if robot i must stay."""
    cell, heading, costs, noise, blocked, occupant, taken, chosen, moves = step
    own_targets, own_moves = np.empty(5, np.int64), np.empty(5, np.int64)
    count = _choices(i, cell, heading, costs[i], noise, blocked, own_targets, own_moves)
    for k in range(count):
        target = own_targets[k]
        if taken[target] >= 0 and taken[target] != i:
            continue
        j = occupant[target]
        if j >= 0 and j != i and chosen[j] >= 0 and _closes_a_ring(i, target, cell, chosen, occupant):
            continue
        chosen[i], moves[i] = target, own_moves[k]  # also what tells j's chain where a ring would close
        taken[target] = i
        asked = j >= 0 and j != i and chosen[j] < 0
        if not asked or _decide(j, step):
            return True
    chosen[i], moves[i] = cell[i], heading[i]
    taken[cell[i]] = i
    return False


@kernel
def pibt_step(cell, heading, costs, order, held, tail, noise, blocked):
    """Return each robot's next cell int64[N] and move int64[N]: its next heading, + BACKWARDS in reverse.

    cell int64[N], distinct; heading int64[N]; costs int32[N, 4, H * W], each robot's cost_to_go; order int64[N]:
    highest priority first; held bool[N]: robots that stay; tail int64[N]: a cell that no other robot may enter, or -1;
    noise float64[N, 5]: added to the costs of the moves, below 0.5 to break ties only; blocked bool[H, W].
    """
    n = cell.size
    occupant, taken = np.full(blocked.size, -1, np.int64), np.full(blocked.size, -1, np.int64)
    chosen, moves = np.full(n, -1, np.int64), heading.copy()
    for i in range(n):
        occupant[cell[i]] = i
        if tail[i] >= 0:
            taken[tail[i]] = i
        if held[i]:
            chosen[i] = cell[i]
            taken[cell[i]] = i
    step = Choosing(cell, heading, costs, noise, blocked, occupant, taken, chosen, moves)
    for i in order:
        if chosen[i] < 0:
            _decide(i, step)
    return chosen, moves
