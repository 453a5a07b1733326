"""The colony's walk, compiled Python against plain C (ant_walk.c): the same moves, and how long each takes."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.benchmarks.native import address, load
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.ants.colony import run, walk
from warehouse_env.planning.ants.floor import Floor, Table, make_floor
from warehouse_env.planning.ants.system import AntSystem
from warehouse_env.planning.ants.walks import Walks, empty_walks

SOURCE = Path(__file__).parent / "ant_walk.c"

Walk = Callable[..., Callable[[], object]]  # takes the arguments of colony.walk, returns the call that is timed


def c_walk(folder: Path) -> Walk:
    """Compile ant_walk.c into the folder; WarehouseError without a compiler."""
    native = load(SOURCE, folder).walk
    native.restype = None

    def walked(
        floor: Floor, trail: Table, turning: Table, straight: Table, seeds: NDArray[np.uint64], q0: float,
        backtrack: bool, local: tuple[float, float], visited: NDArray[np.int64], stamp: int, walks: Walks,
    ) -> Callable[[], object]:  # fmt: skip
        number, real, at = ctypes.c_int64, ctypes.c_double, address
        return partial(
            native, number(len(visited)), number(len(seeds)), at(floor.neighbour), number(floor.goal), at(trail),
            at(turning), at(straight), at(seeds), real(q0), ctypes.c_int(backtrack), real(local[0]), real(local[1]),
            at(visited), number(stamp), at(walks.start), at(walks.moves), at(walks.steps),
        )  # fmt: skip

    return walked


class Compared(NamedTuple):
    """The walks of one search, ours and those in C."""

    ours: float  # [s] processor time, the same on a busy machine
    c: float  # [s] likewise
    same: bool  # every ant made the same moves in both


def compare(system: AntSystem, grid: GridMap, start: Cell, goal: Cell, in_c: Walk, seed: int) -> Compared:
    """Plan once; in each iteration both let its ants walk once more, and only that is timed.

    The one that goes first alternates, since the second finds the tables in the processor's cache.
    """
    floor = make_floor(grid, goal, system.gentleness)
    ants = np.full(system.ants, start[0] * floor.columns + start[1])
    colony = system.colony(grid, floor, ants)
    seeds = np.random.default_rng(seed).integers(1, 2**63, size=(system.iterations, system.ants), dtype=np.uint64)
    ways: tuple[Walk, Walk] = (partial(partial, walk), in_c)
    walks = [empty_walks(ants.copy(), len(floor.height)) for _ in ways]
    visited = [np.zeros(len(floor.height), np.int64) for _ in ways]
    seconds, same = [0.0, 0.0], []

    def update(iteration: int, pheromone: Table, walked: Walks, best: Walks) -> None:
        local, stamp = (colony.local_decay, colony.local_level), 1 + iteration * system.ants
        q0 = colony.greedy(iteration) if colony.greedy else 0.0
        tables = [table.copy() for table in colony.attraction(iteration)]
        for k in ((0, 1), (1, 0))[iteration % 2]:
            trail = pheromone**colony.trail_power
            back = system.dead_end == "backtrack"
            call = ways[k](floor, trail, *tables, seeds[iteration], q0, back, local, visited[k], stamp, walks[k])
            begin = time.thread_time()
            call()
            seconds[k] += time.thread_time() - begin
        same.append(same_moves(*walks))
        colony.update(iteration, pheromone, walked, best)

    watched = replace(colony, update=update)
    run(floor, watched, ants, system.iterations, np.random.default_rng(seed))
    return Compared(seconds[0], seconds[1], all(same))


def same_moves(one: Walks, other: Walks) -> bool:
    """Did the same ants of both arrive, after the same moves?"""
    made = np.arange(one.moves.shape[1]) < one.steps[:, None]
    return np.array_equal(one.steps, other.steps) and np.array_equal(one.moves[made], other.moves[made])
