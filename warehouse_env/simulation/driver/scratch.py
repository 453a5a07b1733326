"""The arrays that a search for manoeuvres works in: made once, and lent to one search after another.

A search reads nothing that the one before it has left behind. One set takes 1.2 MB, and 900 bytes more for each robot
of a world: as many sets are made as searches run at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.simulation.driver.turning import MOVES

BODY = 7  # columns of a body (bodies.py)
NODE, GOAL = 7, 6  # columns of a node, and of a goal: X to MARGIN, and X to COST
X, Y, HEADING, COSINE, SINE, COST, MARGIN = range(
    7
)  # [m], [rad]; [s] so far, or from a goal on; of arcs from there [m]
MOST = 6000  # nodes of a search
WAITING = 8  # times as many moves that may wait in its queue
SLOTS = 1 << 14  # of the table of cells, more than twice MOST
POINTS = 81  # of the field of how far room is, each way (room_field.py)
NEAR_GOALS, FAR_GOALS = 11, 23  # at most (rejoin.py, docking.py)
SHOT = 5  # arcs of a shot at most (shots.py)


class Nodes(NamedTuple):
    """The poses that a search has reached."""

    poses: NDArray[np.float32]  # [MOST, NODE]
    parents: NDArray[np.int32]  # [MOST], -1: the start
    by: NDArray[np.int8]  # [MOST], the move that leads there from its parent


class Cells(NamedTuple):
    """A hash table of the cells of (x, y, heading) that a search has been in."""

    keys: NDArray[np.int32]  # [SLOTS], 0: nothing
    seconds: NDArray[np.float32]  # [SLOTS], the soonest


class Queue(NamedTuple):
    """Moves that wait to be looked at, and the heap that says which is the soonest."""

    keys: NDArray[np.float32]  # [WAITING * MOST] of the heap
    items: NDArray[np.int32]  # [WAITING * MOST] of the heap: numbers of moves
    origins: NDArray[np.int32]  # [WAITING * MOST], the node at which a move begins
    moves: NDArray[np.int8]  # [WAITING * MOST], which of MOVES it is
    ends: NDArray[np.bool_]  # [WAITING * MOST], whether it ends the search


class Scratch(NamedTuple):
    """All arrays of one search, and those of who is to search (traffic/making_room.py)."""

    nodes: Nodes
    cells: Cells
    queue: Queue
    moves: NDArray[np.float32]  # [MOVES, 9] (turning.py)
    room: NDArray[np.float32]  # [POINTS, POINTS]
    near: NDArray[np.float32]  # [NEAR_GOALS, GOAL]
    far: NDArray[np.float32]  # [FAR_GOALS, GOAL]
    shot: NDArray[np.float32]  # [SHOT, 2]
    bodies: NDArray[np.float32]  # [robots + people, BODY], gone round
    rooms: NDArray[np.float32]  # [robots + people] [m], kept off these
    avoid: NDArray[np.float32]  # [robots * poses, BODY], to be off in the end
    found: NDArray[np.int64]  # [4, robots] (traffic/waits.py)
    poses: NDArray[np.int32]  # [robots], of their paths


def make_scratch(robots: int, people: int = 0, poses: int = 1) -> Scratch:
    """Return the arrays for searches in worlds of so many robots and people; poses: of a path at most."""
    many, bodies = WAITING * MOST, robots + people

    def floats(*shape: int) -> NDArray[np.float32]:
        return np.empty(shape, np.float32)

    def whole(*shape: int) -> NDArray[np.int32]:
        return np.empty(shape, np.int32)

    return Scratch(
        Nodes(floats(MOST, NODE), whole(MOST), np.empty(MOST, np.int8)),
        Cells(whole(SLOTS), floats(SLOTS)),
        Queue(floats(many), whole(many), whole(many), np.empty(many, np.int8), np.empty(many, np.bool_)),
        floats(MOVES, 9),
        floats(POINTS, POINTS),
        floats(NEAR_GOALS, GOAL),
        floats(FAR_GOALS, GOAL),
        floats(SHOT, 2),
        floats(bodies, BODY),
        floats(bodies),
        floats(robots * poses, BODY),
        np.empty((4, robots), np.int64),
        whole(robots),
    )


class ScratchPool:
    """Lends sets of arrays for worlds of one size: makes another only while all others are lent."""

    def __init__(self, robots: int, people: int, poses: int) -> None:
        self._sizes = robots, people, poses
        self._free: list[Any] = []

    @contextmanager
    def lent(self) -> Iterator[Scratch]:
        """Lend a set of arrays to the caller alone; threads may ask at once."""
        try:
            scratch = self._free.pop()
        except IndexError:
            scratch = make_scratch(*self._sizes)
        try:
            yield scratch
        finally:
            self._free.append(scratch)
