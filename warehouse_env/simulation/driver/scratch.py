"""Scratch arrays of the manoeuvre search: allocated once and lent to one kernel call after another.

A search reads nothing that an earlier one left. A set for 20,000 nodes takes 3.4 MB plus 1 kB per robot of a world;
there are as many sets as concurrent kernel calls.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.simulation.driver.turning import MOVES

BODY = 7  # columns of a body (bodies.py)
NODE, GOAL = 7, 6  # columns of a node, and of a goal: X to MARGIN, and X to COST
# [m], [rad]; [s] so far, or from a goal on; of arcs from there [m]
X, Y, HEADING, COSINE, SINE, COST, MARGIN = range(7)
MOST = 20_000  # nodes of a search
WAITING = 8  # times as many moves that may wait in its queue
POINTS = 81  # of the field of how far room is, each way (room_field.py)
NEAR_GOALS, FAR_GOALS = 11, 23  # at most (traffic/recovery.py, docking.py)
SHOT = 5  # arcs of a shot at most (shots.py)


class Nodes(NamedTuple):
    """The poses that the search has reached, `nodes` at most."""

    poses: NDArray[np.float32]  # [nodes, NODE]
    parents: NDArray[np.int32]  # [nodes], -1: the start
    by: NDArray[np.int8]  # [nodes], the move that leads there from its parent


class Cells(NamedTuple):
    """Hash table of visited cells of (x, y, heading)."""

    keys: NDArray[np.int32]  # [S], 0: free; S: a power of 2, more than twice the nodes
    seconds: NDArray[np.float32]  # [S], least cost of the cell


class Queue(NamedTuple):
    """Queued moves, and the heap that orders them."""

    keys: NDArray[np.float32]  # [WAITING * nodes] of the heap
    items: NDArray[np.int32]  # [WAITING * nodes] of the heap: numbers of moves
    origins: NDArray[np.int32]  # [WAITING * nodes], the node at which a move begins
    moves: NDArray[np.int8]  # [WAITING * nodes], which of MOVES it is
    ends: NDArray[np.bool_]  # [WAITING * nodes], whether it ends the search


class SearchScratch(NamedTuple):
    """All arrays of the searches of one kernel call."""

    nodes: Nodes
    cells: Cells
    queue: Queue
    moves: NDArray[np.float32]  # [MOVES, 9] (turning.py)
    room: NDArray[np.float32]  # [POINTS, POINTS]
    near: NDArray[np.float32]  # [NEAR_GOALS, GOAL]
    far: NDArray[np.float32]  # [FAR_GOALS, GOAL]
    shot: NDArray[np.float32]  # [SHOT, 2]
    bodies: NDArray[np.float32]  # [robots + people, BODY], obstacles
    rooms: NDArray[np.float32]  # [robots + people] [m], distances kept from them
    avoid: NDArray[np.float32]  # [robots * poses, BODY], bodies that the end pose must be off
    found: NDArray[np.int64]  # [4, robots] (traffic/waits.py)
    poses: NDArray[np.int32]  # [robots], poses of each path (traffic/deadlock_recovery.py)


def make_search_scratch(robots: int, people: int = 0, poses: int = 1, nodes: int = MOST) -> SearchScratch:
    """Return scratch for worlds of so many robots and people; poses: the most that a path has."""
    many, slots = WAITING * nodes, 1 << (2 * nodes).bit_length()
    bodies, floats, ints, bytes_ = robots + people, np.float32, np.int32, np.int8
    return SearchScratch(
        Nodes(np.empty((nodes, NODE), floats), np.empty(nodes, ints), np.empty(nodes, bytes_)),
        Cells(np.empty(slots, ints), np.empty(slots, floats)),
        Queue(
            np.empty(many, floats), np.empty(many, ints), np.empty(many, ints), np.empty(many, bytes_),
            np.empty(many, np.bool_),
        ),
        np.empty((MOVES, 9), floats), np.empty((POINTS, POINTS), floats), np.empty((NEAR_GOALS, GOAL), floats),
        np.empty((FAR_GOALS, GOAL), floats), np.empty((SHOT, 2), floats), np.empty((bodies, BODY), floats),
        np.empty(bodies, floats), np.empty((robots * poses, BODY), floats), np.empty((4, robots), np.int64),
        np.empty(robots, ints),
    )  # fmt: skip
