"""Prices of moves near other robots, computed for the cells that a replanning query asks for.

live.py explains the prices. Each price is one function here, its call and its fields of `Prices`, so each can be
removed alone. Prices are whole thousandths of a cell: their sums do not depend on the order in which the
table (route_occupancy.py) lists robots. They are computed in float64 where a kernel would widen a float32, since plain
Python would not.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part, whole
from warehouse_env.planning.cost_to_go import UNIT, UNREACHABLE, octile, to_go
from warehouse_env.simulation.traffic.route_occupancy import NOTHING, ONCE, RouteOccupancy, eighth, waited_at
from warehouse_env.simulation.traffic.waits import DEARER

ANY = whole(np.iinfo(np.int32).max // 2)  # more than any route costs
DEAREST = 1_000_000  # thousandths of a cell that a robot's time of standing can make a cell cost


class Prices(NamedTuple):
    """Prices in cells of path, except for `crowd_within`. They were chosen together: docs/measured/trials.md."""

    standing: float = 10.0  # for entering the cell of a robot that stands
    beside: float = 3.0  # for entering a cell beside it
    against: float = 1.0  # for a move against one of another's remaining route
    boxed_against: float = 8.0  # so in an aisle of one cell, where two cannot pass
    crowd: float = 0.6  # for entering a cell of another's route that both robots reach at the same time
    crowd_within: float = 10.0  # [m] difference of these distances at which that has faded to nothing
    turn: float = 1.0  # for beginning with a turn of 90 degrees, twice that for turning round
    boxed_turn: float = 30.0  # for beginning with a turn of more than 90 degrees in an aisle of one cell
    waited: float = 1.3  # for entering a cell, for each recent look at which a robot waited there


PRICES = Prices()


def prices_for(size: float, spread: int) -> Prices:
    """Return the prices for bodies of another size in cells (RobotSpec.longer / cell).

    spread: cells to either side that a standing body covers; each of them is charged.
    """
    each, turn = size / (2 * spread + 1), size
    return PRICES._replace(
        standing=PRICES.standing * each, beside=PRICES.beside * each, waited=PRICES.waited * each,
        turn=PRICES.turn * turn, boxed_turn=PRICES.boxed_turn * turn,
    )  # fmt: skip


_SLACK = 6  # [cells] by which a robot's place along its cells may differ from its place along its route
OFF_HEADING = (0.0, 0.2, 1.0, 2.0, 2.0)  # times `turn`, for beginning so many eighths off the heading


class PriceCache(NamedTuple):
    """The prices of one query by cell; `looks` marks those of the present query."""

    looks: NDArray[np.int64]  # [1], number of queries
    at: NDArray[np.int64]  # [C], the query in which a cell was priced
    enter: NDArray[np.int32]  # [C], what entering a cell costs
    leave: NDArray[np.int32]  # [C, 8], what leaving it by each move costs


def make_price_cache(cells: int) -> PriceCache:
    """Return room for the prices of so many cells."""
    return PriceCache(
        np.zeros(1, np.int64), np.zeros(cells, np.int64), np.zeros(cells, np.int32), np.zeros((cells, 8), np.int32)
    )


class ReplanQuery(NamedTuple):
    """One robot's search for a better route: its inputs, and where the robot is. Costs are thousandths of a cell."""

    passing: RouteOccupancy  # the occupancy of cells, up to date
    asked: PriceCache
    robots: NDArray[Any]  # ROBOT[N] of its world, whose number is `world`
    steps: NDArray[np.int32]  # [H, W, 8], costs of moves without other robots; 0: illegal
    prices: Prices
    size: np.float32  # [m] of a cell
    world: int
    me: int
    row: int
    column: int
    field: NDArray[np.int32]  # [h, w], the cost-to-go of its goal from the cell (top, left) on
    top: int
    left: int
    hairpin: int  # what a turn of more than 90 degrees costs
    horizon: int  # how far it looks; from there on it goes the shortest way


@inline
def rest_from(look, row, column):
    """Return the cost from a cell to the goal without other robots; UNREACHABLE outside the field."""
    return to_go(look.field, look.top, look.left, row, column)


@inline
def is_beyond(look, row, column):
    """Whether a cell is at the horizon or beyond."""
    return octile(row - look.row, column - look.column) >= look.horizon


@inline
def _is_boxed(steps, row, column, move):
    """Whether a robot that makes this move from a cell, or the opposite one, could leave it to neither side."""
    return steps[row, column, (move + 2) % 8] == 0 and steps[row, column, (move + 6) % 8] == 0


@inline
def _thousandths(cells):
    return int(round(UNIT * cells))


@part
def _charge_standing(look, cell):
    """Add the price of entering a cell on or beside which others stand. It grows with the robot's own standing time."""
    at, beside = look.passing.standing[look.world, cell, 0], look.passing.standing[look.world, cell, 1]
    own = look.passing.stands_on[look.world, look.me]
    columns, spread = look.steps.shape[1], look.passing.spread
    if own != NOTHING:
        off = max(abs(own // columns - cell // columns), abs(own % columns - cell % columns))
        if off <= spread:
            at -= 1
        elif off == spread + 1:
            beside -= 1
    if at > 0 or beside > 0:
        dearer = 1.0 + np.float64(look.robots[look.me]["clocks"]["standing_time"]) / DEARER
        price = _thousandths(dearer * (at * look.prices.standing + beside * look.prices.beside))
        look.asked.enter[cell] += min(price, DEAREST)


@inline
def _charge_waiting(look, cell):
    """Add the price of entering a cell where others waited lately: the robot may have to wait there too."""
    look.asked.enter[cell] += waited_at(look.passing, look.world, cell) * _thousandths(look.prices.waited) // ONCE


@inline
def _charge_against(look, cell, slot):
    """Add the prices of moves against the way-point of another's route that is listed in a slot."""
    back = whole(look.passing.back[look.world, slot])
    boxed = _is_boxed(look.steps, cell // look.steps.shape[1], cell % look.steps.shape[1], back)
    dear = _thousandths(look.prices.boxed_against if boxed else look.prices.against)
    look.asked.leave[cell, back] += dear
    look.asked.leave[cell, (back + 1) % 8] += dear // 2
    look.asked.leave[cell, (back + 7) % 8] += dear // 2


@inline
def _charge_crowd(look, cell, mine, theirs):
    """Add the price of entering a cell to which one has `mine` [m] to go, and another `theirs` along its route."""
    apart = abs(mine - theirs)
    if apart < look.prices.crowd_within:
        look.asked.enter[cell] += _thousandths(look.prices.crowd * (1.0 - apart / look.prices.crowd_within))


@part
def _charge_passing(look, cell):
    """Add the prices of a cell that others will pass."""
    row, column = cell // look.steps.shape[1], cell % look.steps.shape[1]
    slots = look.passing.cell.shape[1] // look.passing.low.shape[1]
    mine = octile(row - look.row, column - look.column) / UNIT * np.float64(look.size)
    slot = look.passing.first[look.world, cell]
    while slot != NOTHING:
        other = slot // slots
        if other != look.me:
            ahead = (slot - other * slots - look.passing.low[look.world, other]) % slots + 1
            _charge_against(look, cell, slot)
            _charge_crowd(look, cell, mine, ahead * np.float64(look.passing.spacing[look.world, other]))
        slot = look.passing.after[look.world, slot]


@part
def _charge_turns(look, cell):
    """Add the prices of turning away from a robot's heading to the moves that leave its cell."""
    ahead = int(round(np.float64(look.robots[look.me]["motion"]["heading"]) / (0.25 * math.pi))) % 8
    boxed = _is_boxed(look.steps, look.row, look.column, ahead)
    for move in range(8):
        off = (move - ahead) % 8
        off = min(off, 8 - off)
        look.asked.leave[cell, move] += _thousandths(look.prices.turn * OFF_HEADING[off])
        if boxed and off > 2:
            look.asked.leave[cell, move] += _thousandths(look.prices.boxed_turn)


@inline
def ask(look, cell):
    """Price a cell (flat index), unless this query has done so."""
    if look.asked.at[cell] != look.asked.looks[0]:
        _charge(look, cell)


@part
def _charge(look, cell):
    """Price a cell."""
    look.asked.at[cell] = look.asked.looks[0]
    look.asked.enter[cell] = 0
    for move in range(8):
        look.asked.leave[cell, move] = 0
    _charge_standing(look, cell)
    _charge_waiting(look, cell)
    _charge_passing(look, cell)
    if cell == look.row * look.steps.shape[1] + look.column:
        _charge_turns(look, cell)


@inline
def price_of(look, cell, move, to):
    """Return the price of a move between two cells (flat indices) [thousandths of a cell]."""
    ask(look, cell)
    ask(look, to)
    return int(look.asked.leave[cell, move]) + int(look.asked.enter[to])


@part
def next_cell(look, cells):
    """Return the index of the next cell ahead of a robot among the cells that its route was made of.

    A route keeps right of these cells and cuts their corners, so the nearest one around the robot's progress counts.
    """
    r, last = look.robots[look.me], len(cells) - 1
    on_route = r["on_route"]
    about = int(
        on_route["position"] / (max(on_route["spacing"], np.float32(1e-6)) * max(on_route["points"] - 1, 1)) * last
    )
    nearest, least = last, UNREACHABLE
    for k in range(max(about - _SLACK, 0), min(about + _SLACK, last) + 1):
        apart = octile(cells[k, 0] - look.row, cells[k, 1] - look.column)
        if apart <= least:
            nearest, least = k, apart
    return max(min(nearest + 1, last), 0)


@part
def cost_ahead(look, cells):
    """Return the cost of keeping the present route up to the horizon, and of the shortest way from there.

    cells: int32[L, 2], the cells that its route was made of. The cells that the line itself crosses would make it seem
    dearer than a new route.
    """
    row, column, total = look.row, look.column, 0
    for k in range(next_cell(look, cells), len(cells)):
        i, j = whole(cells[k, 0]), whole(cells[k, 1])
        if i == row and j == column:
            continue
        move = eighth(i - row, j - column)
        total += max(octile(i - row, j - column), int(look.steps[row, column, move]))
        total += price_of(look, row * look.steps.shape[1] + column, move, i * look.steps.shape[1] + j)
        row, column = i, j
        if is_beyond(look, row, column):
            break
    return total + rest_from(look, row, column)


@part
def most_for(look, cells, saving):
    """Begin a query; return the most that a way may cost to save `saving` compared with the present route."""
    look.asked.looks[0] += 1
    return ANY if saving < 0 else cost_ahead(look, cells) - saving
