"""Goals drawn by counter: endpoints, distinct at any moment in a world."""

from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel, part, whole
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.draws import GOAL, KIND, below

NONE = -1  # no endpoint
_BLIND = 8  # draws of a goal before all free ones are listed


class GoalState(NamedTuple):
    """The goals of the robots of B worlds, as numbers of endpoints."""

    goal: NDArray[np.int32]  # [B, N]; NONE: no goal yet, or another cell
    next_kind: NDArray[np.int8]  # [B, N], into Endpoints.kinds
    drawn: NDArray[np.int32]  # [B, N], goals drawn so far
    taken: NDArray[np.bool_]  # [B, E]: a robot's goal

    @classmethod
    def of(cls, worlds: int, robots: int, endpoints: int) -> Self:
        """Return the state of worlds without goals."""
        each = worlds, robots
        taken = np.zeros((worlds, endpoints), np.bool_)
        return cls(np.full(each, NONE, np.int32), np.zeros(each, np.int8), np.zeros(each, np.int32), taken)


class Endpoints(NamedTuple):
    """The E endpoints of a floor."""

    cells: NDArray[np.int32]  # [E, 2] (row, column)
    kinds: tuple[NDArray[np.int32], NDArray[np.int32]]  # numbers of the pick faces and of the stations
    all: NDArray[np.int32]  # numbers of all
    number: NDArray[np.int32]  # [H, W], NONE elsewhere
    elsewhere: NDArray[np.int32]  # [K, 2], the other cells from which all endpoints can be reached and back


@lru_cache(maxsize=16)
def endpoints_of(grid: GridMap) -> Endpoints:
    """Return the endpoints of a floor."""
    picks, stations, places = grid.endpoints
    number = np.full(grid.shape, NONE, np.int32)
    number[tuple(np.transpose(places))] = numbers = np.arange(len(places), dtype=np.int32)
    kinds = number[tuple(np.transpose(picks))], number[tuple(np.transpose(stations))]
    elsewhere = np.argwhere(grid.return_region(places[0]) & (number == NONE))
    cells = np.array(places, np.int32), np.ascontiguousarray(elsewhere, np.int32)
    return Endpoints(cells[0], kinds, numbers, number, cells[1])


@kernel
def forget_goals(state, world, key):
    """Forget a world's goals; each robot's first is a pick face or a station, by chance. key: see draws.Key."""
    for number in range(state.taken.shape[1]):
        state.taken[world, number] = False
    for robot in range(state.goal.shape[1]):
        state.goal[world, robot], state.drawn[world, robot] = NONE, 0
        state.next_kind[world, robot] = below(key, KIND, robot, 0, 0, 2)


@part
def draw(numbers, taken, at, key, robot, drawn):
    """Draw one of some endpoints, neither taken nor `at`; NONE if there is none.

    drawn: how many goals, this one included, were drawn for the robot.
    """
    for attempt in range(_BLIND):
        number = numbers[below(key, GOAL, robot, drawn, attempt, len(numbers))]
        if not taken[number] and number != at:
            return number
    free = whole(0)
    for k in range(len(numbers)):
        free += not taken[numbers[k]] and numbers[k] != at
    left = below(key, GOAL, robot, drawn, whole(_BLIND), free) if free > 0 else -1
    for k in range(len(numbers)):
        if not taken[numbers[k]] and numbers[k] != at:
            if left == 0:
                return numbers[k]
            left -= 1
    return np.int32(NONE)


@kernel
def next_goal(state, world, robot, at, key, endpoints):
    """Give a robot its next goal, neither where it is nor the goal of another, and return it.

    Its kind alternates where that can be had. at: number of the endpoint where the robot is, or NONE. NONE: the goal
    is where it is, since all are taken.
    """
    state.drawn[world, robot] += 1
    kind, taken, drawn = state.next_kind[world, robot], state.taken[world], whole(state.drawn[world, robot])
    wanted = endpoints.kinds[0] if kind == 0 else endpoints.kinds[1]
    goal = draw(wanted, taken, at, key, robot, drawn)
    if goal == NONE:
        goal = draw(endpoints.all, taken, at, key, robot, drawn)
    if state.goal[world, robot] != NONE:
        taken[state.goal[world, robot]] = False
    state.goal[world, robot], state.next_kind[world, robot] = (at if goal == NONE else goal), 1 - kind
    if state.goal[world, robot] != NONE:
        taken[state.goal[world, robot]] = True
    return goal
