"""Kernels that find one live route: a way around all others, and the line along it (live.py says when)."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel, part, whole
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.maps.standing import centre_of
from warehouse_env.planning.cost_to_go import UNIT, UNREACHABLE, to_go
from warehouse_env.planning.graph_search import START
from warehouse_env.routes.lanes import drivable_line
from warehouse_env.simulation.traffic import ants, replan_search
from warehouse_env.simulation.traffic.ants import Trails
from warehouse_env.simulation.traffic.prices import PriceCache, Prices, ReplanQuery, most_for, rest_from
from warehouse_env.simulation.traffic.replan_search import Labels
from warehouse_env.simulation.traffic.route_occupancy import (
    NOTHING,
    RouteOccupancy,
    Site,
    forget_route,
    keep_all_up,
    keep_up,
)

HORIZON = 40 * UNIT  # from a robot, up to which it looks; from there its way is the shortest
NEAR = 25.0  # [m] from the end of what is laid of a route at which a robot is near it


class LiveArrays(NamedTuple):
    """What kernels read and write that make live routes in B worlds on a floor of H x W cells with E endpoints."""

    passing: RouteOccupancy
    persons: NDArray[Any]  # PERSON[B, M]
    person_on: NDArray[np.int32]  # [B, M], see RoadUsers
    laid: NDArray[np.float32]  # [B, N] [m] of each robot's route that are drivable
    cells: NDArray[np.int32]  # [B, N, L, 2], of which its route was made ...
    counts: NDArray[np.int32]  # [B, N], ... so many
    changed: NDArray[np.bool_]  # [B, N], the robots that have arrived or got a route in this step
    site: Site
    known: NDArray[np.bool_]  # [E], whether there is a field to the endpoint
    fields: NDArray[np.int32]  # [E, H, W], costs-to-go; of no endpoints where floors are too large for that
    number: NDArray[np.int32]  # [H, W], of endpoints; -1 elsewhere
    steps: NDArray[np.int32]  # [H, W, 8], see ReplanQuery, ...
    prices: Prices
    hairpin: int  # ... also for this
    saving: int  # [thousandths of a cell], that a new route must save
    reach: float  # [m] of a route that are made drivable at once
    floor: tuple[NDArray[np.uint8], NDArray[np.uint8], float, float, float]  # as `drivable_line` takes it


class LiveRoom(NamedTuple):
    """Scratch for the searches of one thread."""

    asked: PriceCache
    labels: Labels | None  # of the search (replan_search.py); None: ants look
    trails: Trails | None
    path: NDArray[np.int64]  # see make_path


@part
def to_goal(live, goal):
    """Return the number of the endpoint in a cell (row, column); -1 if there is none, or no field to it is known."""
    number = whole(live.number[goal])
    return number if number >= 0 and len(live.fields) > 0 and live.known[number] else -1


@kernel
def first_move(field, top, left, steps, row, column):
    """Return the move of MOVES that begins a cheapest way from a cell to a field's goal; NOTHING if there is none."""
    rest = to_go(field, top, left, row, column)
    for move in range(8):
        step = steps[row, column, move]
        there = to_go(field, top, left, row + MOVES[move, 0], column + MOVES[move, 1])
        if step > 0 and there != UNREACHABLE and there + step == rest:
            return move
    return NOTHING


@part
def _lead(look, most, seed, labels, trails, path):
    """Let the planner that has scratch lead to the horizon; return (cells, last move), 0 cells: none up to `most`."""
    if labels is not None:
        return replan_search.lead(look, most, labels, path)
    if trails is not None:
        return ants.lead(look, most, seed, trails, path)
    return 0, START


@kernel
def find_cells(at, here, goal, when, users, live, room):
    """Write the cells of a route around all others to room.path; return how many, 0 if there is none, or none better.

    A planner leads to the horizon. From there the way is a cheapest one to the goal, which turns where it must, and
    then as little as it can. Without a better route, a robot on its way continues along its present cells if what is
    laid of its route runs out.

    at: (world, robot); here: the robot's cell (row, column); goal: its field int32[h, w], and the row and column at
    which that begins; when: (the world's env step, whether the robot is on its way there already, a seed for ants).
    """
    (b, i), (row, column), (field, top, left), (step, on_its_way, seed) = at, here, goal, when
    cells = live.cells[b, i, : live.counts[b, i]]
    keep_all_up(live.passing, b, step, users, live.site)
    look = ReplanQuery(
        live.passing, room.asked, users.robots[b], live.steps, live.prices, live.site.size, b, i,
        row, column, field, top, left, live.hairpin, HORIZON,
    )  # fmt: skip
    count, arrived, most = 0, START, most_for(look, cells, live.saving if on_its_way else -1)
    if rest_from(look, row, column) <= most:
        count, arrived = _lead(look, most, seed, room.labels, room.trails, room.path)
    if count > 0:
        return replan_search.write_tail(look, count, arrived, room.path)
    runs_out = on_its_way and runs_out_of(users.robots[b, i], live.laid[b, i])
    return replan_search.write_rest(look, cells, room.path) if runs_out else 0


@kernel
def find_live(at, here, goal, when, users, live, room):
    """Return a route's line float32[R, 2] [m], and how many cells it leads along; see `find_cells`.

    goal: an endpoint's number.
    """
    (b, i), path = at, room.path
    count = find_cells(at, here, (live.fields[goal], whole(0), whole(0)), when, users, live, room)
    solid, one_way, size, keep_right, wider = live.floor
    centres, motion = np.empty((max(count, 1), 2)), users.robots[b, i]["motion"]
    for k in range(count):
        centres[k, 0], centres[k, 1] = centre_of(path[k, 0], path[k, 1], live.steps.shape[0], size)
    centres[0, 0], centres[0, 1] = motion["x"], motion["y"]
    return drivable_line(centres, solid, one_way, size, keep_right, wider, live.reach), count


@kernel
def list_route(at, cells, laid, users, live):
    """List the new route of robot at[1] of world at[0] in the table in place of its last one.

    cells int[L, 2]: that it was made of, which are kept; laid [m]: how much of it is drivable.
    """
    b, i = at
    forget_route(live.passing, b, i)
    for k in range(len(cells)):
        live.cells[b, i, k, 0], live.cells[b, i, k, 1] = cells[k, 0], cells[k, 1]
    live.counts[b, i], live.laid[b, i], live.changed[b, i] = len(cells), laid, True
    keep_up(live.passing, b, i, users.robots[b, i], users.routes[b, i], live.site)


@kernel
def runs_out_of(r, laid):
    """Whether a robot comes near the end of what is laid of its route, which is `laid` [m] long."""
    on_route = r["on_route"]
    return on_route["position"] + np.float32(NEAR) > laid and laid < (on_route["points"] - 1) * on_route["spacing"]
