"""Live routes: who is routed anew and when, what others cost, and that nothing depends on the batch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.simulation.worlds import give_line, room, stage, write
from warehouse_env.config import EnvConfig
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES, GridMap
from warehouse_env.planning.cost_to_go import DIAGONAL, UNIT, CostToGo
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import PERSON, ROBOT, field_of
from warehouse_env.simulation.traffic import live
from warehouse_env.simulation.traffic.ants import colonise, make_trails
from warehouse_env.simulation.traffic.live import SLOTS, LiveRoutes, find_due, keep_barred
from warehouse_env.simulation.traffic.prices import (
    ANY,
    PRICES,
    Prices,
    ReplanQuery,
    cost_ahead,
    make_price_cache,
    price_of,
)
from warehouse_env.simulation.traffic.replan_search import make_labels, search
from warehouse_env.simulation.traffic.route_occupancy import (
    RoadUsers,
    RouteOccupancy,
    Site,
    keep_all_up,
    make_occupancy,
    note_waiting,
)
from warehouse_env.traffic_spec import TrafficSpec

EAST, NORTH, WEST, SOUTH = 0, 2, 4, 6
ROWS, COLUMNS = 5, 9
NOBODY_WALKS = np.zeros((1, 0), PERSON), np.zeros((1, 0), np.int32)


EVERY, STOOD_FOR = live.EVERY, live.STOOD_FOR


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots look twice as often, and stand sooner, so that short episodes suffice."""
    monkeypatch.setattr(live, "EVERY", 2.0)
    monkeypatch.setattr(live, "STOOD_FOR", 2.0)


def record(*robots: dict[str, Any]) -> Any:
    """ROBOT[1, N], alive and facing east but for what is given."""
    found = np.zeros((1, len(robots)), ROBOT)
    found["task"]["alive"] = 1
    found["motion"]["cos"] = 1.0
    found["on_route"]["spacing"] = 1.0
    for i, fields in enumerate(robots):
        for name, value in fields.items():
            field_of(found[0], name)[i] = value
    return found


def eastwards(count: int, row: int, columns: range) -> Any:
    """Routes float32[1, N, R, 2] of which the first runs through these cells of a row."""
    routes = np.zeros((1, count, len(columns), 2), np.float32)
    routes[0, 0] = [(column + 0.5, ROWS - 0.5 - row) for column in columns]
    return routes


def looks(robots: Any, step: int = 0, every: int = 1) -> Any:
    out = np.empty(robots.shape, np.bool_)
    assert find_due(robots, np.array([step]), every, out) == out.sum()
    return out


ONE = np.float32(1.0)
SITE = Site(ONE, ROWS, COLUMNS, 6.0, np.zeros(64, np.float32))  # a robot stands after 6 s; bodies' centres on the axle


def table_of(robots: Any, routes: Any) -> RouteOccupancy:
    table = make_occupancy(1, robots.shape[1], ROWS * COLUMNS, SLOTS)
    keep_all_up(table, 0, 0, RoadUsers(robots, routes, *NOBODY_WALKS), SITE)
    return table


def barred(robots: Any, routes: Any, look_ahead: float = 25.0, **when: int) -> list[bool]:
    out = looks(robots, **when)
    table, laid = make_occupancy(1, robots.shape[1], ROWS * COLUMNS, SLOTS), np.full(robots.shape, np.inf, np.float32)
    users = RoadUsers(robots, routes, *NOBODY_WALKS)
    keep_barred(table, users, SITE, look_ahead, laid, np.array([0]), out)
    return [bool(found) for found in out[0]]


FREE = Prices(0.0, 0.0, 0.0, 0.0, 0.0, PRICES.crowd_within, 0.0, 0.0, 0.0)


def steps_of(legal: Any) -> Any:
    """What moves cost on a floor where these are legal, bool[H, W, 8]."""
    return (np.where(np.arange(8) % 2, DIAGONAL, UNIT) * legal).astype(np.int32)


def all_moves(rows: int = ROWS, columns: int = COLUMNS) -> Any:
    return GridMap(np.zeros((rows, columns), bool), picks=[(0, 0)], stations=[(0, 1)]).legal_moves.copy()


NO_FIELD = np.empty((0, 0), np.int32)


def look_of(robots: Any, routes: Any, me: int, legal: Any = None, **prices: float) -> ReplanQuery:
    steps = steps_of(all_moves() if legal is None else legal)
    row, column = ROWS - 1 - int(robots[0, me]["motion"]["y"]), int(robots[0, me]["motion"]["x"])
    asked = make_price_cache(ROWS * COLUMNS)
    asked.looks[0] = 1
    table, priced = table_of(robots, routes), FREE._replace(**prices)
    return ReplanQuery(
        table, asked, robots[0], steps, priced, ONE, 0, me, row, column, NO_FIELD, 0, 0, 10 * UNIT, 40 * UNIT
    )


@kernel
def price_all(look: ReplanQuery, cost: Any) -> None:
    for cell in range(cost.shape[0] * cost.shape[1]):
        row, column = cell // cost.shape[1], cell % cost.shape[1]
        for move in range(8):
            if look.steps[row, column, move]:
                to = (row + MOVES[move, 0]) * cost.shape[1] + column + MOVES[move, 1]
                cost[row, column, move] = price_of(look, cell, move, to)


def prices_of(look: ReplanQuery) -> Any:
    """What others make each legal move cost, int64[H, W, 8]; 0 for the others."""
    price_all(look, cost := np.zeros(look.steps.shape, np.int64))
    return cost


def costs(robots: Any, routes: Any, me: int, legal: Any = None, **prices: float) -> Any:
    """What others make each legal move cost [cells], float64[H, W, 8]; 0 for the others."""
    return prices_of(look_of(robots, routes, me, legal, **prices)) / UNIT


def test_a_robot_counts_as_standing_once_it_has_not_moved_a_metre_for_so_long_or_is_parked() -> None:
    robots = record({"x": 0.5, "y": 2.5, "points": 9}, {"x": 6.5, "y": 2.5, "standing_time": 5.9})
    routes = eastwards(2, 2, range(9))
    assert barred(robots, routes) == [False, False]
    robots[0, 1]["clocks"]["standing_time"] = 6.0
    assert barred(robots, routes) == [True, False]
    robots[0, 1]["clocks"]["standing_time"], robots[0, 1]["task"]["alive"] = 0.0, 0
    assert barred(robots, routes) == [True, False]


@pytest.mark.parametrize(
    ("x", "y", "ahead", "found"),
    [
        (6.5, 2.5, 25.0, True),  # on the way
        (6.5, 3.5, 25.0, True),  # beside it
        (6.5, 4.4, 25.0, False),  # two cells off
        (6.5, 2.5, 4.0, True),  # the cell before it, column 5, is the fifth from here
        (6.5, 2.5, 3.0, False),
        (0.5, 1.5, 25.0, True),  # beside the robot, and beside the next cell
    ],
)
def test_the_way_ahead_is_barred_by_one_in_or_beside_it(x: float, y: float, ahead: float, found: bool) -> None:
    robots = record({"x": 0.5, "y": 2.5, "points": 9}, {"x": x, "y": y, "standing_time": 9.0})
    assert barred(robots, eastwards(2, 2, range(9)), look_ahead=ahead) == [found, False]


def test_nobody_bars_his_own_way_and_what_is_behind_bars_none() -> None:
    robots = record({"x": 4.5, "y": 2.5, "points": 9, "position": 4.0, "standing_time": 9.0})
    assert barred(robots, eastwards(1, 2, range(9))) == [False]
    robots = record({"x": 4.5, "y": 2.5, "points": 9, "position": 4.0}, {"x": 2.5, "y": 2.5, "standing_time": 9.0})
    assert barred(robots, eastwards(2, 2, range(9))) == [False, False]


def test_all_but_arrived_and_parked_robots_replan_in_turn() -> None:
    robots = record(*({"x": 0.5, "y": 2.5, "points": 9} for _ in range(5)))  # nobody stands
    robots["events"]["arrived"][0, 3], robots["task"]["alive"][0, 4] = 1, 0
    looked = [looks(robots, step, every=10)[0] for step in range(20)]
    assert np.sum(looked, axis=0).tolist() == [2, 2, 2, 0, 0]
    assert max(sum(row) for row in looked) == 1


def test_robots_find_better_routes_where_nobody_stands_unless_only_the_barred_look(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = {}
    monkeypatch.setattr(live, "EVERY", 1.0)
    monkeypatch.setattr(live, "STOOD_FOR", 1e4)
    for only_barred in (False, True):
        simulator = Simulator(CONFIG.replace(traffic=TrafficSpec(routes="barred" if only_barred else True)))
        simulator.reset([5])
        drive(simulator, 50)
        found[only_barred] = int(simulator.robots["totals"]["reroutes"].sum())
    assert found[True] == 0 < found[False]


def test_a_robot_that_stands_makes_its_cell_dear_and_those_around_it() -> None:
    robots = record({"x": 0.5, "y": 2.5}, {"x": 6.5, "y": 2.5, "standing_time": 9.0}, {"x": 8.5, "y": 4.5})
    cost = costs(robots, eastwards(3, 2, range(9)), 0, standing=10.0, beside=3.0)
    assert cost[2, 5, EAST] == 10.0
    assert cost[2, 4, EAST] == cost[3, 7, WEST] == cost[0, 6, SOUTH] == 3.0
    assert cost[2, 6, EAST] == 3.0  # leaving it for the cell beside
    assert cost[2, 3, EAST] == 0.0
    assert not costs(robots, eastwards(3, 2, range(9)), 1, standing=10.0, beside=3.0).any()  # nobody is in his own way
    robots[0, 0]["clocks"]["standing_time"] = 40.0  # who has stood long himself goes a longer way round
    assert costs(robots, eastwards(3, 2, range(9)), 0, standing=10.0, beside=3.0)[2, 5, EAST] == 30.0


def test_cells_where_others_have_waited_at_a_look_cost_and_half_as_much_ten_looks_later() -> None:
    robots = record({"x": 0.5, "y": 2.5}, {"x": 6.5, "y": 2.5, "waiting_time": 5.0}, {"x": 8.5, "y": 4.5})
    look = look_of(robots, eastwards(3, 2, range(9)), 0, waited=3.0)
    every = 4

    def cost_at(step: int, who_look: list[bool]) -> list[float]:
        note_waiting(look.passing, robots, np.array([who_look]), np.array([step]), every, SITE)
        look.asked.looks[0] += 1
        found: list[float] = (prices_of(look)[2, [5, 4, 7], EAST] / UNIT).tolist()
        return found

    assert cost_at(0, [True, False, True]) == [0.0, 0.0, 0.0]  # who drives notes nothing, nor who does not look
    assert cost_at(1, [False, True, False]) == [3.0, 0.0, 0.0]
    assert cost_at(5, [False, True, False]) == [6.0, 0.0, 0.0]
    assert cost_at(10 * every, [False, False, False]) == [3.0, 0.0, 0.0]
    assert cost_at(20 * every, [False, True, False]) == [4.5, 0.0, 0.0]
    assert cost_at(1000 * every, [False, False, False]) == [0.0, 0.0, 0.0]


def test_moves_against_what_is_left_of_a_route_cost() -> None:
    robots = record({"x": 2.5, "y": 2.5, "points": 9, "position": 2.0}, {"x": 8.5, "y": 4.5})
    cost = costs(robots, eastwards(2, 2, range(9)), 1, against=2.0)
    west = cost[2, :, WEST]
    assert west.tolist() == [0, 0, 0, 2, 2, 2, 2, 2, 2]
    np.testing.assert_array_equal(cost[2, :, WEST - 1], 0.5 * west)
    np.testing.assert_array_equal(cost[2, :, WEST + 1], 0.5 * west)
    assert cost.sum() == 2 * west.sum()
    robots[0, 0]["task"]["alive"] = 0
    assert not costs(robots, eastwards(2, 2, range(9)), 1, against=2.0).any()


def test_moves_against_a_route_cost_their_own_price_where_two_cannot_pass() -> None:
    robots = record({"x": 0.5, "y": 2.5, "points": 9}, {"x": 8.5, "y": 4.5})
    legal = all_moves()
    legal[2, 3:6, NORTH] = legal[2, 3:5, SOUTH] = False  # an aisle of one cell, columns 3 and 4, which 5 leads into
    cost = costs(robots, eastwards(2, 2, range(9)), 1, legal, against=1.0, boxed_against=8.0)
    west = cost[2, :, WEST]
    assert west.tolist() == [0, 1, 1, 8, 8, 1, 1, 1, 1]
    np.testing.assert_array_equal(cost[2, :, WEST - 1], 0.5 * west)
    assert not cost[:, :, EAST].any()


def test_cells_where_another_will_be_at_the_same_time_cost() -> None:
    robots = record({"x": 0.5, "y": 2.5, "points": 9}, {"x": 4.5, "y": 4.5})  # one goes east in row 2, one is off it
    cost = costs(robots, eastwards(2, 2, range(9)), 1, crowd=2.0, crowd_within=4.0)
    # To (2, 3) one has 3 m to go and the other 2.41 from (0, 4): 2 - 2 * 0.59 / 4. To (2, 4) they have 4 and 2.
    wanted = [0.0, 0.586, 1.586, 1.707, 1.0, 0.707, 0.414, 0.414, 0.414]
    assert cost[1, :, SOUTH].tolist() == pytest.approx(wanted, abs=1e-3)
    assert cost[2, :8, EAST].tolist() == pytest.approx(wanted[1:], abs=1e-3)
    assert not costs(robots, eastwards(2, 2, range(9)), 0, crowd=2.0).any()  # nobody is in his own way


@kernel
def ahead(look: ReplanQuery, cells: Any) -> int:
    return cost_ahead(look, cells)


def test_what_is_left_of_a_route_costs_its_length_and_its_prices_as_far_as_one_looks() -> None:
    robots = record({"x": 2.5, "y": 2.5, "points": 9, "position": 2.0}, {"x": 6.5, "y": 2.5, "standing_time": 9.0})
    routes, cells = eastwards(2, 2, range(9)), np.array([[2, column] for column in range(9)], np.int32)
    floor = CostToGo(GridMap(np.zeros((ROWS, COLUMNS), bool), picks=[(2, 8)], stations=[(2, 0)]))
    field = floor.field((2, 8), floor.whole())
    assert ahead(look_of(robots, routes, 0)._replace(field=field), cells) == 6 * UNIT
    look = look_of(robots, routes, 0, standing=10.0, beside=3.0)._replace(field=field)
    assert ahead(look, cells) == (6 + 3 + 10 + 3) * UNIT
    assert ahead(look._replace(horizon=3 * UNIT), cells) == (6 + 3) * UNIT


def live_of(simulator: Simulator) -> LiveRoutes:
    """The live routes that a simulator's own dispatcher asks."""
    found = simulator.dispatcher.live
    assert found is not None
    return found


def look_for(live: LiveRoutes, simulator: Simulator, me: int = 0, step: int = 1, **how: bool) -> Any:
    """What robot `me` of the first world finds to its goal."""
    robots = simulator.robots[0]
    goal = (int(robots[me]["task"]["goal_row"]), int(robots[me]["task"]["goal_col"]))
    return live.route(simulator.robots, simulator.routes, 0, me, step, goal, **how)


def test_prices_of_permanently_standing_robots_are_bounded() -> None:
    simulator = Simulator(CONFIG)
    simulator.reset([1])
    simulator.robots["clocks"]["standing_time"] = 1e9
    assert look_for(live_of(simulator), simulator) is not None


def test_on_its_way_a_robot_keeps_its_route_unless_a_new_one_saves_enough() -> None:
    simulator = Simulator(CONFIG.replace(num_agents=2))
    simulator.reset([1])
    robots, live = simulator.robots[0], live_of(simulator)
    assert look_for(live, simulator, on_its_way=True) is None
    assert look_for(live, simulator) is not None
    x, y = simulator.routes[0, 0, int(robots[0]["on_route"]["points"]) // 2]
    write(robots[1], x=x, y=y, standing_time=60.0)  # in its way, and stands
    assert look_for(live, simulator, step=2, on_its_way=True) is not None


@pytest.mark.parametrize(("up", "better"), [(1, False), (2, True), (3, True)])
def test_a_route_is_kept_to_the_cell_unless_a_new_one_saves_enough(
    up: int, better: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On an open floor the route goes `up` cells aside and back, so straight on saves twice that; four are asked."""
    monkeypatch.setattr(live, "SAVING", 4.0)
    simulator = stage(room(12, 16), (2.5, 2.5, 0.0), planner="astar_turns", traffic="routes")
    bend = [(x, 2.5) for x in (2.5, 3.5, 4.5)] + [(5.5, 2.5 + k) for k in range(up + 1)]
    back = [(6.5, 2.5 + k) for k in range(up, -1, -1)] + [(x, 2.5) for x in (7.5, 8.5, 9.5, 10.5)]
    give_line(simulator, 0, bend + back)
    goal = tuple(simulator.grid.cell([10.5, 2.5]).tolist())
    route = live_of(simulator).route(simulator.robots, simulator.routes, 0, 0, 0, goal, on_its_way=True)
    assert (route is not None) == better


def test_turning_away_from_the_heading_costs_and_more_where_there_is_no_room() -> None:
    robots = record({"x": 2.5, "y": 2.5})
    cost = costs(robots, eastwards(1, 2, range(9)), 0, turn=3.0, boxed_turn=30.0)
    assert cost[2, 2].tolist() == pytest.approx([0.0, 0.6, 3.0, 6.0, 6.0, 6.0, 3.0, 0.6])
    legal = all_moves()
    legal[2, 2, [NORTH, SOUTH]] = False
    cost = costs(robots, eastwards(1, 2, range(9)), 0, legal, turn=3.0, boxed_turn=30.0)
    assert cost[2, 2, [EAST, WEST]].tolist() == [0.0, 36.0]


CONFIG = EnvConfig(
    layout="narrow", num_agents=24, planner="astar_turns", max_steps=10_000, action_repeat=2,
    traffic="routes",
)  # fmt: skip
STEPS = 250


def drive(simulator: Simulator, steps: int = STEPS) -> None:
    for _ in range(steps):
        simulator.step(np.broadcast_to(simulator.cruise_action, (simulator.num_worlds, simulator.num_agents)))


def test_a_new_route_begins_at_the_robot_and_ends_at_the_same_goal_and_the_task_keeps_its_length() -> None:
    simulator = Simulator(CONFIG)
    simulator.reset([5])
    seen = 0
    for _ in range(STEPS):
        before = simulator.robots[0].copy()
        drive(simulator, 1)
        r = simulator.robots[0]
        for i in np.flatnonzero(r["totals"]["reroutes"] > before["totals"]["reroutes"]):
            seen += 1
            route = simulator.routes[0, i, : r[i]["on_route"]["points"]]
            np.testing.assert_allclose(route[0], [r[i]["motion"]["x"], r[i]["motion"]["y"]], atol=1e-5)
            np.testing.assert_array_equal(route[-1], [r[i]["task"]["goal_x"], r[i]["task"]["goal_y"]])
            assert r[i]["on_route"]["position"] == 0.0
            if r[i]["totals"]["goals"] == before[i]["totals"]["goals"]:
                assert r[i]["totals"]["task_length"] == before[i]["totals"]["task_length"]
                now, then = (one[i]["clocks"]["stalled_time"] for one in (r, before))
                assert now >= then or now < 0.2  # a new route is no progress; a metre driven in this very step is
    assert seen > 0


@pytest.mark.parametrize("routes", [True, "barred"])
def test_kernels_give_the_goals_and_routes_that_python_gives(routes: bool | str) -> None:
    """Both begin with too little room for the longest routes."""
    config = CONFIG.replace(traffic=TrafficSpec(routes=routes), layout="single_lane")
    here, there = Simulator(config, 3), Simulator(config, 3)
    assert here.dispatcher.by_live
    there.dispatcher.by_live = there.dispatcher.begins_by_kernel = False
    rng = np.random.default_rng(1)
    assert here.reset(5).tobytes() == there.reset(5).tobytes()
    for _ in range(STEPS):
        given = np.where(rng.random((3, 24)) < 0.2, rng.integers(0, 20, (3, 24)), here.cruise_action)
        assert here.step(given).tobytes() == there.step(given).tobytes()
        assert here.arrivals == there.arrivals
    assert here.robots["totals"]["reroutes"].sum() > 0 < here.robots["totals"]["goals"].sum()


def test_waiting_fades_by_the_clock_whatever_is_simulated_beside() -> None:
    periods = []
    for worlds in (1, 2):
        simulator = Simulator(CONFIG.replace(num_agents=1), worlds)
        simulator.reset(5)
        simulator.robots["task"]["alive"][0] = 0  # so nobody of this world looks
        live_of(simulator).watch(simulator.robots, simulator.routes, np.full(worlds, 10_000))
        periods.append(live_of(simulator).arrays.passing.period[0])
    assert periods[0] == periods[1] > 0


def test_stored_prices_are_read_where_they_are_those_of_today() -> None:
    prices = {name: value for name, value in TrafficSpec.retired.items() if name in PRICES._fields}
    assert len(prices) == 8
    assert prices.items() <= PRICES._asdict().items()
    numbers = {"every": EVERY, "look_ahead": live.LOOK_AHEAD, "stood_for": STOOD_FOR, "saving": live.SAVING}
    assert numbers.items() <= TrafficSpec.retired.items()


def test_a_robot_in_its_goal_cell_keeps_its_route_to_the_middle() -> None:
    simulator = Simulator(CONFIG)
    simulator.reset([1])
    r = simulator.robots[0, 0]
    live = live_of(simulator)
    assert look_for(live, simulator) is not None
    goal = r["task"]
    write(r, x=goal["goal_x"] - 0.4, y=goal["goal_y"] - 0.4)  # farther off than the radius in which it has arrived
    assert look_for(live, simulator) is None


@kernel
def cheapest(look: ReplanQuery, most: int, labels: Any) -> tuple[int, int]:
    return search(look, most, labels)


@kernel
def by_ants(look: ReplanQuery, most: int, seed: int, trails: Any) -> tuple[int, int]:
    look.asked.looks[0] += 1
    return colonise(look, most, seed, trails)


def crowd(layout: str, robots: int, steps: int = 0, seed: int = 3) -> tuple[Simulator, list[ReplanQuery]]:
    """Robots on their way, of whom the first two stand, and the look of each."""
    simulator = Simulator(CONFIG.replace(layout=layout, num_agents=robots))
    simulator.reset([seed])
    drive(simulator, steps)
    records, grid = simulator.robots[0], simulator.grid
    records["clocks"]["standing_time"][:2] = 7.7
    size, floor, looks = np.float32(grid.cell_size), CostToGo(grid), []
    site = Site(size, *grid.shape, 6.0, np.full(robots, 0.3, np.float32))
    table, asked = make_occupancy(1, robots, grid.occupied.size, SLOTS), make_price_cache(grid.occupied.size)
    keep_all_up(table, 0, 0, RoadUsers(simulator.robots, simulator.routes, *NOBODY_WALKS), site)
    for me, r in enumerate(records):
        field = floor.field((int(r["task"]["goal_row"]), int(r["task"]["goal_col"])), floor.whole())
        cell = grid.cell([r["motion"]["x"], r["motion"]["y"]])
        where = (me, *cell.tolist(), field, 0, 0, 10 * UNIT, 40 * UNIT)
        looks.append(ReplanQuery(table, asked, records, floor.steps, PRICES, size, 0, *where))
    return simulator, looks


def test_ants_find_ways_that_cost_little_more_than_the_cheapest_and_never_less() -> None:
    """Of 30 robots among 32 on `narrow`, where two of them stand in the way of others."""
    simulator, looks = crowd("narrow", 32, 60)
    labels, trails = make_labels(*simulator.grid.shape), make_trails(*simulator.grid.shape)
    best, walked = [], []
    for look in looks[2:]:
        look.asked.looks[0] += 1
        best.append(cheapest(look, ANY, labels)[1])
        steps, cost = by_ants(look, ANY, 7, trails)
        walked.append(cost)
        assert cost == cost_of(look, trails.best[:steps])
    assert all(cost >= least for cost, least in zip(walked, best, strict=True))
    assert sum(walked) < 1.05 * sum(best)
    assert sum(cost == least for cost, least in zip(walked, best, strict=True)) > 10


def cost_of(look: ReplanQuery, moves: Any) -> int:
    """What moves from the robot on cost at the prices of others and of hairpins, and then the shortest way."""
    costs, total, arrived, row, column = look.steps + prices_of(look), 0, None, look.row, look.column
    for move in moves.tolist():
        assert look.steps[row, column, move] > 0
        total += int(costs[row, column, move])
        if arrived is not None and 3 <= (move - arrived) % 8 <= 5:
            total += look.hairpin
        row, column, arrived = row + int(MOVES[move, 0]), column + int(MOVES[move, 1]), move
    return total + int(look.field[row, column])


def test_ants_give_up_where_no_way_is_as_cheap_as_is_asked() -> None:
    simulator, looks = crowd("narrow", 6)
    labels, trails = make_labels(*simulator.grid.shape), make_trails(*simulator.grid.shape)
    for look in looks:
        look.asked.looks[0] += 1
        _, least = cheapest(look, ANY, labels)
        assert cheapest(look, least, labels)[1] == least
        assert cheapest(look, least - 1, labels) == (-1, 0)
        assert by_ants(look, least - 1, 7, trails)[0] == -1


def test_what_a_colony_finds_depends_on_its_seed_and_on_no_look_before() -> None:
    simulator, looks = crowd("narrow", 32, 60)
    used = make_trails(*simulator.grid.shape)

    def found(seed: int, fresh: bool) -> list[Any]:
        rooms = [make_trails(*simulator.grid.shape) if fresh else used for _ in looks]
        return [
            (steps, cost, room.best[:steps].tolist())
            for look, room in zip(looks, rooms, strict=True)
            for steps, cost in [by_ants(look, ANY, seed, room)]
        ]

    first = found(1, fresh=True)
    assert first == found(1, fresh=False) == found(1, fresh=False)
    assert first != found(2, fresh=True)


def test_a_hairpin_has_its_price() -> None:
    """Its back to the goal, a robot drives on by a cell before it turns: by a diagonal back, or two right angles."""
    floor = CostToGo(GridMap(np.zeros((ROWS, COLUMNS), bool)))
    look = look_of(record({"x": 4.5, "y": 2.5}), eastwards(1, 2, range(9)), 0, turn=3.0)
    look = look._replace(field=floor.field((2, 0), floor.whole()))
    labels, trails = make_labels(ROWS, COLUMNS), make_trails(ROWS, COLUMNS)
    for hairpin, cost in ((0, 4 * UNIT + 2 * DIAGONAL), (10, 6 * UNIT + DIAGONAL)):
        priced = look._replace(hairpin=hairpin * UNIT)
        assert cheapest(priced, ANY, labels)[1] == by_ants(priced, ANY, 7, trails)[1] == cost


@pytest.mark.parametrize(
    ("planner", "finder", "first"),
    [("pf_aco", "pf_aco", True), ("pf_aco:ants=9", "pf_aco", True), ("astar_turns", "astar_turns", True),
     ("astar", "astar_turns", False)],
)  # fmt: skip
def test_live_routes_are_made_by_the_planner_of_all_routes_if_it_makes_any(
    planner: str, finder: str, first: bool
) -> None:
    simulator = Simulator(CONFIG.replace(planner=planner, num_agents=2))
    made = simulator.dispatcher.live
    assert made is not None
    assert (made.finder, made.plans_first) == (finder, first)
