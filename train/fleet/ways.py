"""What a robot was ordered to do: from goal to goal, along routes that are replaced under way, as nodes with paths.

An order goes from where a robot is to its goal. Where its route is planned anew, the order is updated: what the robot
may drive for sure (the base) ends where it is then, and the new route begins there. Who writes the messages of an
episode knows beforehand where that will be, so that a base is never taken back.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.fleet.story import Story
from warehouse_env.render.lines import simplified

SPACING = 2.0  # [m] between two nodes
_NEAREST = 0.5  # [m] between a node and the next, at the least
_STANDS = 0.05  # [m] that a robot has hardly moved by
_STRAIGHT = 0.01  # [m] beside a path at which it is taken to go straight on


class Node(NamedTuple):
    """A point of a route, and the way to it."""

    x: float  # [m], in the frame of the map's file, as `y` and `path`
    y: float
    along: float  # [m] of its route
    path: NDArray[np.float64]  # [K, 2] from the node before


class Way(NamedTuple):
    """A route as it is ordered, from moment `begin` on until it is replaced or its goal reached, before `end`."""

    begin: int
    end: int
    nodes: tuple[Node, ...]  # behind the one that it begins at
    sure: int  # of these come into the base


class Order(NamedTuple):
    """From where a robot is to its goal."""

    begin: int  # moment
    reached: int | None  # moment at which it is at its goal, if it ever is
    end: int  # moment at which the next one begins, or all is over
    start: Node
    ways: tuple[Way, ...]
    work: str | None  # what it does at the goal: "pick", "drop" or nothing
    goal: str  # what stands there, in words


def orders_of(story: Story, robot: int) -> list[Order]:
    """Return a robot's orders, one after the other."""
    replay = story.replay
    route = replay.route[:, robot]
    frames = len(route)
    changes = [0, *(np.flatnonzero(np.diff(route)) + 1).tolist()]
    served = story.flag("served")[:, robot]
    stands = story.flag("arrived")[:, robot] | served
    orders: list[Order] = []
    while changes:
        begin = changes[0]
        if served[begin]:  # it stands and has nothing to do
            changes = changes[1:]
            continue
        # a goal is reached with the step after which the next route may stand already
        found = np.flatnonzero(stands[begin + 1 :])
        reached = int(found[0]) + begin + 1 if len(found) else None
        last = frames if reached is None else reached
        pieces = [change for change in changes if change < last]
        rest = [change for change in changes if change >= last]
        end = rest[0] if rest else frames
        orders.append(_order(story, robot, pieces, reached, end))
        changes = rest
    return orders


def _order(story: Story, robot: int, begins: list[int], reached: int | None, end: int) -> Order:
    replay, begin = story.replay, begins[0]
    frames = len(replay.route)
    last = frames if reached is None else reached
    grid = replay.grid
    goal = divmod(int(replay.goal[last - 1, robot]), grid.shape[1])
    kinds = [(grid.stations, "drop", "station"), (grid.picks, "pick", "pick face")]
    work, what = next(((w, n) for cells, w, n in kinds if (cells == goal).all(axis=1).any()), (None, "waiting place"))
    ends = [*begins[1:], last]
    x, y = grid.world(replay.pose[begin, robot, :2]).round(3).tolist()
    start = at = Node(x, y, 0.0, np.array([[x, y]]))
    ways: list[Way] = []
    for first, after in zip(begins, ends, strict=True):
        ways.append(_way(story, robot, first, after, after == last, at))
        at = ways[-1].nodes[ways[-1].sure - 1] if ways[-1].sure else at
    return Order(begin, reached, end, start, tuple(ways), work, f"{what} in row {goal[0]}, column {goal[1]}")


def _way(story: Story, robot: int, begin: int, end: int, lasts: bool, start: Node) -> Way:
    """Return the route of the moments from `begin` up to `end`.

    lasts: until the goal is reached, or all is over; start: the node that it goes on from.
    """
    replay = story.replay
    points = replay.grid.world(replay.routes[int(replay.route[begin, robot])])
    if len(points) == 1:  # it is there already
        points = np.repeat(points, 2, axis=0)
    steps = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    stop = None if lasts else float(replay.along[end - 1, robot])
    marks = list(_marks(float(along[-1]), stop))
    there = None if lasts else replay.grid.world(replay.pose[end, robot, :2])  # where the next route begins
    nodes, before, at = list[Node](), -1.0, np.array([start.x, start.y])
    for mark in marks:
        here = np.array([np.interp(mark, along, points[:, axis]) for axis in (0, 1)])
        if there is not None and mark == stop:
            here = there
        between = points[(along > before + 1e-6) & (along < mark - 1e-6)]
        path = np.concatenate([[at], between, [here]])
        path = simplified(path, _STRAIGHT).astype(np.float64).round(3)
        x, y = path[-1].tolist()
        nodes.append(Node(x, y, mark, path))
        before, at = mark, here
    sure = len(nodes) if stop is None else sum(mark <= stop for mark in marks)
    return Way(begin, end, tuple(nodes), sure)


def _marks(length: float, stop: float | None) -> Iterator[float]:
    """Yield where nodes stand on a route [m], its end among them; stop: where its robot gets another."""
    stops = stop is not None and stop > _STANDS
    fixed = [length, *([stop] if stops and stop is not None and stop < length else [])]
    even = np.arange(SPACING, length, SPACING).tolist()
    yield from sorted([*(mark for mark in even if all(abs(mark - other) >= _NEAREST for other in fixed)), *fixed])
