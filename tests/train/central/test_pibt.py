"""PIBT on the grid against an independent checker; its plans as orders at cells, as lines and as evaluation rows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from train.central import CENTRAL, central_config
from train.central.grid_pibt import BACKWARDS, cost_to_go, pibt_step
from train.central.orders import CentralOrders, advance, append, forget_future
from train.central.pibt import rounded
from train.evaluation.rollout import make_experiment, run
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.simulator import Simulator

STEPS = {0: (0, 1), 1: (-1, 0), 2: (0, -1), 3: (1, 0)}


def check_step(
    blocked: NDArray[np.bool_], cell: list[int], heading: list[int], chosen: list[int], moves: list[int]
) -> None:
    """Raise unless robots can make their moves, and no two meet on a cell, on an edge or in a ring."""
    columns = blocked.shape[1]
    assert len(set(chosen)) == len(chosen), "two robots in a cell"
    where = {at: i for i, at in enumerate(cell)}
    for i, (old, new, move) in enumerate(zip(cell, chosen, moves, strict=True)):
        assert not blocked[new // columns, new % columns]
        if old == new:
            assert move == heading[i]
            continue
        way = move if move < BACKWARDS else (move - BACKWARDS + 2) % 4
        assert move >= BACKWARDS or (move - heading[i]) % 4 != 2, "turned round at once"
        assert move < BACKWARDS or move - BACKWARDS == heading[i], "backed with another heading"
        assert (new // columns - old // columns, new % columns - old % columns) == STEPS[way]
        chain = [i]
        while (j := where.get(chosen[chain[-1]])) is not None and chosen[j] != cell[j]:
            assert j not in chain, "a swap or a ring"
            chain.append(j)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_no_step_breaks_a_rule(seed: int) -> None:
    rng = np.random.default_rng(seed)
    blocked = rng.random((6, 7)) < 0.25
    free = np.flatnonzero(~blocked)
    robots = int(rng.integers(1, max(2, len(free) - 1)))
    cell, heading = rng.permutation(free)[:robots].astype(np.int64), rng.integers(0, 4, robots)
    held, tail = rng.random(robots) < 0.1, np.full(robots, -1)
    costs = np.stack([cost_to_go(blocked, int(goal)) for goal in rng.choice(free, robots)])
    for _ in range(8):
        noise = rng.uniform(0.0, 0.4, (robots, 5))
        chosen, moves = pibt_step(cell, heading, costs, rng.permutation(robots), held, tail, noise, blocked)
        check_step(blocked, cell.tolist(), heading.tolist(), chosen.tolist(), moves.tolist())
        assert (chosen[held] == cell[held]).all()
        cell, heading = chosen, moves % BACKWARDS


def test_the_first_in_order_goes_and_the_other_makes_room() -> None:
    """Head on at the end of an aisle of one cell with a bay: the first drives on, the second goes into the bay."""
    blocked = np.array([[1, 1, 0], [0, 0, 0]], np.bool_)
    costs = np.stack([cost_to_go(blocked, 5), cost_to_go(blocked, 3)])
    cell, heading = np.array([4, 5]), np.array([0, 2])  # nose to nose, the second below the bay
    noise, held, tail = np.zeros((2, 5)), np.zeros(2, np.bool_), np.full(2, -1)
    chosen, moves = pibt_step(cell, heading, costs, np.array([0, 1]), held, tail, noise, blocked)
    assert chosen.tolist() == [5, 2]
    assert moves.tolist() == [0, 1]


def test_a_cell_is_entered_only_when_the_one_before_has_left() -> None:
    """Two robots in a row of cells: the second's visit of a cell is granted when the first's body is out of it."""
    centre = np.stack([np.arange(6) + 0.5, np.full(6, 0.5)], axis=-1)
    orders = CentralOrders.of(np.array([1, 0]), np.array([0, 0]), 6)
    append(orders, np.array([2, 1]), np.array([0, 0]), np.array([True, True]))
    append(orders, np.array([3, 2]), np.array([0, 0]), np.array([True, True]))
    body, heading = np.array([0.45, 0.3, 0.3]), np.zeros(2)
    axle = np.array([[1.5, 0.5], [0.5, 0.5]])
    advance(orders, axle, heading, centre, body, 5)
    assert orders.granted.tolist() == [2, 0]
    axle[0, 0] = 2.6  # its tail at 1.85
    advance(orders, axle, heading, centre, body, 5)
    assert orders.granted.tolist() == [2, 0]
    axle[0, 0] = 2.7  # at 1.95: out of cell 1 but for less than the slack
    advance(orders, axle, heading, centre, body, 5)
    assert orders.granted.tolist() == [2, 1]
    forget_future(orders)
    assert orders.end.tolist() == [3, 2]
    assert orders.planned.tolist() == [1, 1, 1, 1, 0, 0]


@pytest.mark.parametrize("name", list(CENTRAL))
def test_a_central_planner_drives_to_goals_and_makes_rows(name: str) -> None:
    base = EnvConfig(layout="open", num_agents=4, planner="astar")
    experiments = [make_experiment(name, base, episodes, 40.0, seed=3) for episodes in (1, 2)]
    assert experiments[0].config == central_config(base).replace(max_steps=200)
    alone, beside = (run(experiment) for experiment in experiments)
    assert alone[0]["policy"] == name
    assert alone[0]["goals"] > 0
    assert {k: v for k, v in alone[0].items() if k != "ms_per_step"} == {
        k: v for k, v in beside[0].items() if k != "ms_per_step"
    }


@pytest.mark.parametrize("name", list(CENTRAL))
def test_a_reset_begins_a_new_plan(name: str) -> None:
    config = central_config(EnvConfig(layout="open", num_agents=3, planner="astar"))
    simulator, planner, ways = Simulator(config), CENTRAL[name].make(config), []
    for _ in range(2):
        simulator.reset(5)
        generators = [np.random.default_rng(1)]
        for _ in range(20):
            simulator.step(planner.act_on(simulator, generators))
        ways.append(simulator.state.pose.copy())
    assert np.array_equal(ways[0], ways[1])


def test_corners_become_arcs() -> None:
    quarter = rounded(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]))
    arc = quarter[1:-1]
    np.testing.assert_allclose(np.hypot(*(arc - [0.5, 0.5]).T), 0.5, atol=1e-12)
    np.testing.assert_allclose(arc[[0, -1]], [(0.5, 0.0), (1.0, 0.5)], atol=1e-12)
    eighth = rounded(np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 1.0)]))
    radius = np.hypot(*(eighth[1:-1] - [0.5, 0.5 / math.tan(math.pi / 8)]).T)
    assert radius == pytest.approx(0.5 / math.tan(math.pi / 8))
    straight = np.array([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])
    np.testing.assert_array_equal(rounded(straight), straight[[0, 2]])
