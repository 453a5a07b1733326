"""A recorded robot's orders as nodes: from goal to goal, along routes that may be replaced on the way.

A new route updates the order: the base ends where the robot is then, and the new route begins there. The recording
shows beforehand where that will be, so a base is never withdrawn.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.render.replay import FLAGS, Replay, replay_of
from warehouse_env.simulation.record.recording import Episode
from warehouse_env.simulation.tasks.duty import Doing

SPACING = 2.0  # [m] between two nodes
_NEAREST = 0.5  # [m] between two nodes, at least
_STANDS = 0.05  # [m] up to which a robot has not moved


class Story(NamedTuple):
    """One world of N robots at F moments."""

    replay: Replay
    charge: NDArray[np.float64]  # [F, N], share of a full battery; 1 where none is simulated
    charging: NDArray[np.bool_]  # [F, N]
    serving: NDArray[np.bool_]  # [F, N], being loaded or unloaded

    def flag(self, name: str) -> NDArray[np.bool_]:
        """Return bool[F, N], one of the replay's FLAGS."""
        return np.asarray((self.replay.flags >> FLAGS.index(name)) & 1, dtype=np.bool_)


def story_of(episode: Episode, moved: Callable[[], object] = lambda: None) -> Story:
    """Run the first world of an episode again; WarehouseError if its poses differ. moved: called after each moment."""
    work: list[tuple[Any, Any, Any]] = []

    def watch(simulator: Any) -> None:
        work.append(_work_of(simulator.dispatcher.shifts, episode.config.num_agents))
        moved()

    shown = replay_of(episode, "fleet", moved=watch)
    charge, charging, serving = (np.array(column) for column in zip(*work, strict=True))
    return Story(shown, charge.astype(np.float64), charging, serving)


def _work_of(shifts: Any, count: int) -> tuple[NDArray[Any], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return charge, charging and serving [N] of the first world, as Story has them."""
    none = np.zeros(count, np.bool_)
    if shifts is None:
        return ~none, none, none
    doing, batteries = [duty.doing for duty in shifts[0].duties], shifts[0].batteries
    charging, serving = (np.array([one == what for one in doing]) for what in (Doing.CHARGES, Doing.SERVED))
    return ~none if batteries is None else batteries.share.copy(), charging, serving


class OrderNode(NamedTuple):
    """A point of a route."""

    x: float  # [m], in the frame of the map's file, like `y`
    y: float
    along: float  # [m] of its route


class OrderedRoute(NamedTuple):
    """A route as it is ordered, from moment `begin` until it is replaced or its goal is reached, before `end`."""

    begin: int
    end: int
    nodes: tuple[OrderNode, ...]  # after the one at its start
    released: int  # how many of these join the base


class RobotOrder(NamedTuple):
    """From a robot's place to its goal."""

    begin: int  # moment
    reached: int | None  # moment at which it reaches its goal, if it does
    start: OrderNode
    routes: tuple[OrderedRoute, ...]
    work: str | None  # at the goal: "pick", "drop" or nothing
    goal: str  # in words


def orders_of(story: Story, robot: int) -> list[RobotOrder]:
    """Return a robot's orders in turn."""
    replay = story.replay
    route = replay.route[:, robot]
    frames = len(route)
    changes = [0, *(np.flatnonzero(np.diff(route)) + 1).tolist()]
    served = story.flag("served")[:, robot]
    stands = story.flag("arrived")[:, robot] | served
    orders: list[RobotOrder] = []
    while changes:
        begin = changes[0]
        if served[begin]:  # it has nothing to do
            changes = changes[1:]
            continue
        # the step that reaches a goal may already set the next route
        found = np.flatnonzero(stands[begin + 1 :])
        reached = int(found[0]) + begin + 1 if len(found) else None
        last = frames if reached is None else reached
        orders.append(_order(story, robot, [change for change in changes if change < last], reached))
        changes = [change for change in changes if change >= last]
    return orders


def _order(story: Story, robot: int, begins: list[int], reached: int | None) -> RobotOrder:
    """Return the order whose routes begin at these moments."""
    replay, begin, grid = story.replay, begins[0], story.replay.grid
    last = len(replay.route) if reached is None else reached
    goal = divmod(int(replay.goal[last - 1, robot]), grid.shape[1])
    kinds = [(grid.stations, "drop", "station"), (grid.picks, "pick", "pick face")]
    work, what = next(((w, n) for cells, w, n in kinds if (cells == goal).all(axis=1).any()), (None, "waiting place"))
    ends = [*begins[1:], last]
    x, y = grid.world(replay.pose[begin, robot, :2]).round(3).tolist()
    routes = tuple(_route(story, robot, first, after, after == last) for first, after in zip(begins, ends, strict=True))
    return RobotOrder(begin, reached, OrderNode(x, y, 0.0), routes, work, f"{what} in row {goal[0]}, column {goal[1]}")


def _route(story: Story, robot: int, begin: int, end: int, lasts: bool) -> OrderedRoute:
    """Return the route of the moments from `begin` up to `end`; lasts: it is the order's last."""
    replay = story.replay
    points = replay.grid.world(replay.routes[int(replay.route[begin, robot])])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    stop = None if lasts else float(replay.along[end - 1, robot])
    length = float(along[-1])
    fixed = [length, *([stop] if stop is not None and _STANDS < stop < length else [])]
    even = np.arange(SPACING, length, SPACING).tolist()
    nodes = []
    for mark in sorted([*(one for one in even if all(abs(one - other) >= _NEAREST for other in fixed)), *fixed]):
        here = np.array([np.interp(mark, along, points[:, axis]) for axis in (0, 1)])
        if mark == stop:  # where the next route begins
            here = replay.grid.world(replay.pose[end, robot, :2])
        x, y = here.astype(float).round(3).tolist()
        nodes.append(OrderNode(x, y, mark))
    released = len(nodes) if stop is None else sum(node.along <= stop for node in nodes)
    return OrderedRoute(begin, end, tuple(nodes), released)
