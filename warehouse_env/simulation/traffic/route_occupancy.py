"""A table of the floor's cells: robots that stand there or waited there recently, and routes that lead through.

Only the next `HORIZON` metres of each route are listed. As a robot drives on, a few entries are removed at one end and
added at the other, so the cost per robot depends neither on the floor nor on the fleet, and nor does a query.

The contents depend on robots and routes alone. The list of a cell has no particular order, so sums over it must not
depend on the order: prices.py adds whole numbers.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, kernel, whole
from warehouse_env.simulation.physics.people import bars_ways
from warehouse_env.simulation.traffic.waits import bars_routes, gets_nowhere

HORIZON = 40.0  # [m] of a route that counts for others
NOTHING = -1
ONCE = 1024  # a look at which a robot waited; a whole number, so halves are the same on any machine
PERIOD = 10  # looks of a robot, after which what was noted before counts half


class RouteOccupancy(NamedTuple):
    """The table of B worlds with N robots on C cells, each with S slots for the way-points that are listed.

    What prices do not ask for is kept elsewhere: each array more that a look carries makes a search slower.

    Way-point k of robot i is in slot i * S + k % S, if from its first one ahead it is one of the next S.
    """

    first: NDArray[np.int32]  # [B, C], the first slot of each cell's list, or NOTHING
    after: NDArray[np.int32]  # [B, N * S], the next slot of the list that a slot is in
    before: NDArray[np.int32]  # [B, N * S]
    cell: NDArray[np.int32]  # [B, N * S], the cell that the route enters there; NOTHING where it enters none
    back: NDArray[np.int8]  # [B, N * S], the move of MOVES nearest to the way back from there
    low: NDArray[np.int32]  # [B, N], the first way-point that is listed
    high: NDArray[np.int32]  # [B, N], that after the last
    spacing: NDArray[np.float32]  # [B, N] [m] between them
    stands_on: NDArray[np.int32]  # [B, N], the cell on which a robot is counted as standing, or NOTHING
    standing: NDArray[np.int16]  # [B, C, 2], robots and people that stand on a cell; and beside it (`spread`)
    known_at: NDArray[np.int64]  # [B], env step of the table's content
    waited: NDArray[np.int32]  # [B, C], recent looks at which a robot waited on a cell, times ONCE (`note_waiting`)
    waited_in: NDArray[np.int32]  # [B, C], the period of that count
    period: NDArray[np.int32]  # [B], the present one
    spread: int = 0  # cells either way that a standing body is on, of cells smaller than bodies; beside: one more


class Site(NamedTuple):
    """What the table needs to know of the floor and of the robots."""

    size: np.float32  # [m] of a cell
    rows: int
    columns: int
    stood_for: float  # [s] from when on a robot counts as standing
    behind: NDArray[np.float32]  # [N] [m], how far each body's centre is behind its front axle


class RoadUsers(NamedTuple):
    """Robots and people in B worlds."""

    robots: NDArray[Any]  # ROBOT[B, N]
    routes: NDArray[np.float32]  # [B, N, R, 2] [m]
    persons: NDArray[Any]  # PERSON[B, M]
    person_on: NDArray[np.int32]  # [B, M], the cell on which a person is counted as standing, or NOTHING


def make_occupancy(worlds: int, robots: int, cells: int, slots: int, spread: int = 0) -> RouteOccupancy:
    """Return an empty table; spread: see RouteOccupancy."""

    def nothing(*shape: int) -> NDArray[np.int32]:
        return np.full(shape, NOTHING, np.int32)

    each = (worlds, robots * slots)
    return RouteOccupancy(
        nothing(worlds, cells), nothing(*each), nothing(*each), nothing(*each), np.zeros(each, np.int8),
        np.zeros((worlds, robots), np.int32), np.zeros((worlds, robots), np.int32),
        np.zeros((worlds, robots), np.float32), nothing(worlds, robots),
        np.zeros((worlds, cells, 2), np.int16), np.full(worlds, NOTHING, np.int64),
        np.zeros((worlds, cells), np.int32), np.zeros((worlds, cells), np.int32), np.zeros(worlds, np.int32), spread,
    )  # fmt: skip


@inline
def cell_of(x, y, site):
    """Return the cell (flat index) that holds a point [m], or is nearest to it on the floor."""
    row = min(max(site.rows - 1 - int(math.floor(y / site.size)), 0), site.rows - 1)
    return row * site.columns + min(max(int(math.floor(x / site.size)), 0), site.columns - 1)


@inline
def _body_cell(r, behind, site):
    """Return the cell that holds the centre of a body, `behind` [m] the front axle."""
    motion = r["motion"]
    return cell_of(motion["x"] - behind * motion["cos"], motion["y"] - behind * motion["sin"], site)


@inline
def ahead_of(r):
    """Return the number of the first point of a robot's route that is ahead of it."""
    return int(r["on_route"]["position"] / max(r["on_route"]["spacing"], np.float32(1e-6))) + 1


@inline
def eighth(d_row, d_column):
    """Return the index of the move of MOVES that is nearest to a direction in rows and columns."""
    high, wide = abs(d_row), abs(d_column)
    if (high + wide) * (high + wide) > 2 * max(high, wide) * max(high, wide):  # more than 22.5 degrees off both axes
        if d_row < 0:
            return 1 if d_column > 0 else 3
        return 7 if d_column > 0 else 5
    if wide >= high:
        return 0 if d_column >= 0 else 4
    return 2 if d_row < 0 else 6


@kernel
def _list_point(passing, b, i, k, route, site):
    """List way-point k of robot i, if the route enters a cell there."""
    slots = passing.cell.shape[1] // passing.low.shape[1]
    slot, columns = i * slots + k % slots, site.columns
    cell, before = cell_of(route[k, 0], route[k, 1], site), cell_of(route[k - 1, 0], route[k - 1, 1], site)
    if cell == before:
        passing.cell[b, slot] = NOTHING
        return
    head = passing.first[b, cell]
    passing.cell[b, slot] = cell
    passing.back[b, slot] = eighth(before // columns - cell // columns, before % columns - cell % columns)
    passing.after[b, slot], passing.before[b, slot] = head, NOTHING
    if head != NOTHING:
        passing.before[b, head] = slot
    passing.first[b, cell] = slot


@kernel
def _unlist_point(passing, b, i, k):
    """Take way-point k of robot i out of its cell's list."""
    slots = passing.cell.shape[1] // passing.low.shape[1]
    slot = i * slots + k % slots
    cell = passing.cell[b, slot]
    if cell == NOTHING:
        return
    ahead, behind = passing.after[b, slot], passing.before[b, slot]
    if behind == NOTHING:
        passing.first[b, cell] = ahead
    else:
        passing.after[b, behind] = ahead
    if ahead != NOTHING:
        passing.before[b, ahead] = behind
    passing.cell[b, slot] = NOTHING


@kernel
def _count_standing(passing, b, cell, change, site):
    """Add `change` to the count of bodies standing on a cell, and beside its neighbours."""
    row, column, spread = cell // site.columns, cell % site.columns, passing.spread
    for i in range(max(row - 1 - spread, 0), min(row + 2 + spread, site.rows)):
        for j in range(max(column - 1 - spread, 0), min(column + 2 + spread, site.columns)):
            on = abs(i - row) <= spread and abs(j - column) <= spread
            passing.standing[b, i * site.columns + j, 0 if on else 1] += change


@inline
def _stands_now(passing, b, on, k, cell, site):
    """Count robot or person k, of those in `on` int32[B, K], as standing on a cell, or nowhere."""
    if cell != on[b, k]:
        if on[b, k] != NOTHING:
            _count_standing(passing, b, whole(on[b, k]), whole(-1), site)
        if cell != NOTHING:
            _count_standing(passing, b, cell, whole(1), site)
        on[b, k] = cell


@kernel
def keep_up(passing, b, i, r, route, site):
    """Update robot i in the table of world b. r: ROBOT; route: float32[R, 2] [m]."""
    on_route = r["on_route"]
    slots = passing.cell.shape[1] // passing.low.shape[1]
    low, high = whole(passing.low[b, i]), whole(passing.high[b, i])
    first = last = 0
    if r["task"]["alive"] != 0 and on_route["points"] > 1:
        first = min(ahead_of(r), on_route["points"])
        last = min(first + min(slots, int(np.float32(HORIZON) / on_route["spacing"]) + 1), on_route["points"])
    while high > low and high > last:
        high -= 1
        _unlist_point(passing, b, i, high)
    while low < high and low < first:
        _unlist_point(passing, b, i, low)
        low += 1
    if low == high:
        low = high = first
    while low > first:
        low -= 1
        _list_point(passing, b, i, low, route, site)
    while high < last:
        _list_point(passing, b, i, high, route, site)
        high += 1
    passing.low[b, i], passing.high[b, i], passing.spacing[b, i] = low, high, on_route["spacing"]
    stands = _body_cell(r, site.behind[i], site) if bars_routes(r, site.stood_for) else NOTHING
    _stands_now(passing, b, passing.stands_on, i, stands, site)


@kernel
def keep_all_up(passing, b, step, users, site):
    """Update the table of world b to env step `step`."""
    if passing.known_at[b] == step:
        return
    for i in range(users.robots.shape[1]):
        keep_up(passing, b, i, users.robots[b, i], users.routes[b, i], site)
    for m in range(users.persons.shape[1]):
        person = users.persons[b, m]
        stands = cell_of(person["x"], person["y"], site) if bars_ways(person) else NOTHING
        _stands_now(passing, b, users.person_on, m, stands, site)
    passing.known_at[b] = step


@inline
def waited_at(passing, b, cell):
    """Return at how many recent looks a robot waited on a cell, times ONCE; each earlier period counts half."""
    return int(passing.waited[b, cell]) >> min(int(passing.period[b] - passing.waited_in[b, cell]), 30)


@kernel
def note_waiting(passing, robots, looks, steps, every, site):
    """Note where the robots that look now are waiting, once per look: where robots lose time.

    robots: ROBOT[B, N]; looks: bool[B, N]; steps: int64[B]; every: steps between two looks of a robot.
    """
    for b in range(robots.shape[0]):
        passing.period[b] = steps[b] // (PERIOD * every)
        for i in range(robots.shape[1]):
            if looks[b, i] and gets_nowhere(robots[b, i]):
                cell = _body_cell(robots[b, i], site.behind[i], site)
                passing.waited[b, cell] = waited_at(passing, b, cell) + ONCE
                passing.waited_in[b, cell] = passing.period[b]


@kernel
def forget_route(passing, b, i):
    """Remove a robot's route from the table."""
    for k in range(passing.low[b, i], passing.high[b, i]):
        _unlist_point(passing, b, i, whole(k))
    passing.low[b, i] = passing.high[b, i] = 0
