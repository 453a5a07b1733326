"""A user's sampler says where robots start and go; all else is as with the project's own tasks."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any
from unittest import mock

import numpy as np
import pytest

from warehouse_env import EnvConfig, GridMap, Simulator, tensor_env
from warehouse_env.errors import ConfigError, MapError, WarehouseError
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.tasks.sampled import TASKS

CONFIG = EnvConfig(layout="open", num_agents=4, planner="astar", tasks="rows:row=7")


class Rows:
    """Starts in the first column; goals are cells of one row, to and fro."""

    def __init__(self, config: EnvConfig, grid: GridMap, row: int = 5) -> None:
        self.row, self.last = row, grid.shape[1] - 2

    def starts(self, rng: np.random.Generator) -> Any:
        return [(row, 1) for row in 2 + 3 * rng.permutation(6)]

    def goal(self, rng: np.random.Generator, robot: int, at: tuple[int, int], taken: set[tuple[int, int]]) -> Any:
        columns = np.arange(10, self.last) if at[1] < 8 else np.arange(8)
        cells = [(self.row, int(column)) for column in rng.permutation(columns)]
        return np.array(next(cell for cell in cells if cell not in taken))


@pytest.fixture(autouse=True)
def rows() -> Iterator[None]:
    with mock.patch.dict(TASKS, rows=Rows):
        yield


def driven(simulator: Simulator, steps: int) -> list[Any]:
    """Return the goals of all robots after each step at full speed."""
    goals = []
    for _ in range(steps):
        simulator.step(np.full((simulator.num_worlds, 4), simulator.cruise_action))
        goals.append(simulator.state.goal.copy())
    return goals


def test_robots_start_and_go_where_it_says() -> None:
    simulator = Simulator(CONFIG, 2)
    simulator.reset(3)
    cells = simulator.grid.cell(simulator.state.pose[..., :2].reshape(-1, 2))
    assert set(cells[:, 1].tolist()) == {1}
    assert set(cells[:, 0].tolist()) <= {2, 5, 8, 11, 14, 17}
    for goals in driven(simulator, 900):
        assert (goals[..., 0] == 7).all()
        for world in goals:
            assert len(np.unique(world, axis=0)) == 4
    assert simulator.state.goals.sum() > 8
    assert simulator.episode_metrics()["goals"] > 0


@pytest.mark.parametrize("traffic", ["none", "routes"])
def test_draws_are_the_same_in_any_batch_and_in_copies(traffic: Any) -> None:
    config = CONFIG.replace(traffic=traffic)
    wide, alone = Simulator(config, 3), Simulator(config)
    wide.reset([7, 8, 9])
    alone.reset(8)
    np.testing.assert_array_equal(wide.state.pose[1], alone.state.pose[0])
    assert not np.array_equal(wide.state.pose[0], wide.state.pose[1])
    expected = np.concatenate(driven(copy.deepcopy(alone), 200))
    np.testing.assert_array_equal(np.stack(driven(wide, 200))[:, 1], expected)
    np.testing.assert_array_equal(np.concatenate(driven(alone, 200)), expected)
    wide.reset_world(1, 8)
    again = wide.state.pose[1].copy()
    wide.reset_world(1)
    assert not np.array_equal(wide.state.pose[1], again)


def test_goals_of_an_assignment_come_first() -> None:
    simulator = Simulator(CONFIG)
    poses = [(1.5, 2.5 + 3 * k, 0.0) for k in range(4)]
    simulator.reset(0, [Assignment(np.array(poses), np.array([(row, 30) for row in (3, 5, 9, 11)]))])
    assert simulator.state.goal[0, :, 0].tolist() == [3, 5, 9, 11]
    assert driven(simulator, 600)[-1][0, :, 0].tolist() == [7] * 4


@pytest.mark.parametrize(
    ("method", "given", "error", "said"),
    [
        ("goal", (0, 10**6), MapError, "goal by rows:row=7 (0, 1000000) is outside map"),
        ("goal", (3, 3), ConfigError, "rows:row=7 sends robot 1 to (3, 3), where it is or another goes"),
        ("goal", 3, WarehouseError, "goal by rows:row=7"),
        ("starts", [(-1, 0)], MapError, "start by rows:row=7 (-1, 0) is outside map"),
        ("starts", None, ConfigError, "rows:row=7 fails at"),
    ],
)
def test_what_it_cannot_say_is_one_sentence(method: str, given: Any, error: type[Exception], said: str) -> None:
    with mock.patch.object(Rows, method, return_value=given), pytest.raises(error) as refused:
        Simulator(CONFIG).reset(0)
    assert said in str(refused.value)


def test_unknown_tasks_and_tasks_on_a_device_are_refused() -> None:
    with pytest.raises(ConfigError, match="unknown tasks 'row'; did you mean rows"):
        Simulator(CONFIG.replace(tasks="row"))
    with pytest.raises(ConfigError, match="a device does not simulate own tasks"):
        tensor_env(2, CONFIG, device="cpu")


def test_with_too_few_starts_the_others_begin_elsewhere() -> None:
    with mock.patch.object(Rows, "starts", return_value=[(5, 1)]):
        simulator = Simulator(CONFIG)
        simulator.reset(0)
    cells = simulator.grid.cell(simulator.state.pose[0, :, :2])
    assert cells[0].tolist() == [5, 1]
    assert len(np.unique(cells, axis=0)) == 4
