"""Paper 002's obstacle that comes into the way: the tasks are what they say, each answer is walked as meant."""

from __future__ import annotations

import numpy as np
import pytest

from train.reporting.rows import Row
from train.tables.papers.avoidance import (
    ANSWERS,
    CROSSING,
    GAIN,
    ONCOMING,
    REACH,
    STANDING,
    Avoider,
    avoid,
    cells_of,
    met_at,
    obstacles,
)
from train.tables.study import TableTask
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import make_planner


def open_task(start: Cell, goal: Cell, *obstacle: Cell) -> TableTask:
    return TableTask(GridMap(np.zeros((9, 13), dtype=np.bool_)), start, goal, ((obstacle[0], obstacle[-1]),))


def walked(task: TableTask, label: str) -> Row:
    return avoid(task, make_planner("astar_turns"), np.random.default_rng(0), answer=ANSWERS[label])


def test_steps_in_which_two_robots_meet() -> None:
    assert met_at([(0, 0), (0, 1), (0, 2)], [(0, 3), (0, 2), (0, 1)]) == 1  # change places
    assert met_at([(0, 0), (0, 1), (0, 2)], [(2, 1), (1, 1), (0, 1)]) is None  # one behind the other
    assert met_at([(0, 0), (0, 1)], [(0, 2), (0, 1)]) == 0


def test_tasks_are_what_they_say_and_a_heedless_robot_is_touched() -> None:
    planner = make_planner("astar_turns")
    for seed in range(4):
        for kind, task in obstacles(seed).items():
            path, other = (cells_of(planner, task.grid, *one) for one in task.ends)
            step, shared = met_at(path, other), len(set(path) & set(other))
            assert (step is None) == (kind == STANDING)
            assert step is None or len(path) // 4 <= step < 3 * len(path) // 4
            assert {STANDING: shared == 1, CROSSING: shared <= 1, ONCOMING: shared > 4}[kind]
            touched = walked(task, "follows its path")
            assert touched["contacts"]
            assert not touched["success"]


def test_answers_to_an_obstacle_that_comes_head_on_stands_or_crosses() -> None:
    head_on, stands = open_task((4, 0), (4, 12), (4, 12), (4, 0)), open_task((4, 0), (4, 12), (4, 6))
    assert not walked(head_on, "waits")["success"]
    assert walked(head_on, "new route")["success"]
    row = walked(stands, "new route")
    assert row["apart"] == 2.0  # round its neighbours, too
    # Three straight to where it replans, a diagonal, one up beside the corner, four along, two diagonals, two on.
    assert row["length"] == pytest.approx(10 + 3 * 2**0.5)
    assert not walked(stands, "waits")["success"]
    crossing = walked(open_task((4, 2), (4, 12), (0, 6), (8, 6)), "waits")  # both on (4, 6) in step 4
    assert crossing["success"]
    assert crossing["length"] == 10.0
    assert crossing["last"] > 10.0


def test_the_force_repels_when_near_and_attracts_when_far() -> None:
    robot = Avoider(open_task((4, 4), (4, 12), (0, 0)), make_planner("astar_turns"))
    assert robot.pushed((4, 5), (4, 12), 1.0) == (4, 3)
    # At 3 cells: the push is 60 (1/3 - 1/4) / 9 = 0.56, for n = 1 times 8 to the goal, under the pull of 8.
    assert (GAIN, REACH) == (60.0, 4.0)
    assert robot.pushed((4, 7), (4, 12), 1.0) == robot.pushed((4, 7), (4, 12), 0.0) == (4, 5)


@pytest.mark.parametrize("label", [label for label in ANSWERS if label != "follows its path"])
def test_the_robot_never_steps_onto_the_obstacle(label: str) -> None:
    robot = Avoider(open_task((4, 4), (4, 12), (0, 0)), make_planner("astar_turns"))
    for obstacle in ((3, 4), (5, 5), (4, 5)):
        assert ANSWERS[label](robot, obstacle) != obstacle
