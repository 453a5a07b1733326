"""Paper 002's obstacle that comes into the way: the tasks are what they say, each answer is walked as meant."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from train.reporting.rows import Row
from train.tables.code import DRIVING, _closure
from train.tables.papers.avoidance import FORESIGHT, GAIN, MODES, REACH, Robot, avoid, cells_of, obstacle_path
from train.tables.papers.coordinator import duration
from train.tables.papers.moving_obstacle import CROSSING, MAPS, ONCOMING, STANDING, met_at
from train.tables.papers.moving_obstacle import settings as build
from train.tables.study import Setting, System, TableTask
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import make_planner, validate

MOVED = 4  # maps that the slower checks walk


@cache
def settings() -> dict[str, Setting]:
    return {setting.name: setting for setting in build()}


def open_task(start: Cell, goal: Cell, *obstacle: Cell) -> TableTask:
    return TableTask(GridMap(np.zeros((9, 13), dtype=np.bool_)), start, goal, ((obstacle[0], obstacle[-1]),))


def walked(task: TableTask, mode: str) -> Row:
    return avoid(task, System(mode, "astar_turns", mode=mode), np.random.default_rng(0))


def test_steps_in_which_two_meet() -> None:
    assert met_at([(0, 0), (0, 1), (0, 2)], [(0, 3), (0, 2), (0, 1)]) == 1  # change places
    assert met_at([(0, 0), (0, 1), (0, 2)], [(2, 1), (1, 1), (0, 1)]) is None  # one behind the other
    assert met_at([(0, 0), (0, 1)], [(0, 2), (0, 1)]) == 0


def test_tasks_are_what_they_say() -> None:
    assert {name: len(setting.tasks) for name, setting in settings().items()} == dict.fromkeys(
        (STANDING, CROSSING, ONCOMING), MAPS
    )
    for name, setting in settings().items():
        for task in setting.tasks:
            path = cells_of(make_planner("astar_turns"), task.grid, task.start, task.goal)
            other = obstacle_path(task)
            shared = len(set(path) & set(other))
            if name == STANDING:
                assert len(other) == 1
                assert other[0] in path[len(path) // 4 : 3 * len(path) // 4]
            else:
                step = met_at(path, other)
                assert step is not None
                assert len(path) // 4 <= step < 3 * len(path) // 4
                assert shared <= 1 if name == CROSSING else shared > 4


def test_who_heeds_nobody_is_touched_on_every_map() -> None:
    for setting in settings().values():
        for task in setting.tasks:
            row = walked(task, "heedless")
            assert row["contacts"]
            assert not row["success"]


def test_foresight_is_the_quickest_of_all() -> None:
    for setting in settings().values():
        for task in setting.tasks[:MOVED]:
            best = walked(task, FORESIGHT)
            assert best["success"]
            assert best["gap"] >= -1e-9
            for mode in MODES:
                row = walked(task, mode)
                assert not row["success"] or row["last"] >= best["last"] - 1e-9
                if row["success"]:
                    validate(task.grid, row["cells"], task.start, task.goal)
                    path = [(r, c) for r, c in row["cells"]]
                    assert duration(path) == pytest.approx(row["length"])


def test_answers_to_one_that_comes_head_on_and_to_one_that_stands() -> None:
    head_on = open_task((4, 0), (4, 12), (4, 12), (4, 0))
    assert not walked(head_on, "heedless")["success"]
    assert not walked(head_on, "wait")["success"]
    assert walked(head_on, FORESIGHT)["length"] == pytest.approx(10 + 2 * 2**0.5)
    assert walked(head_on, "new route")["success"]
    stands = open_task((4, 0), (4, 12), (4, 6))
    assert walked(stands, FORESIGHT)["length"] == pytest.approx(10 + 2 * 2**0.5)
    round_its_neighbours = walked(stands, "new route")
    assert round_its_neighbours["apart"] == 2.0
    assert walked(stands, "wait")["contacts"] == 0.0


def test_waiting_lets_a_crossing_one_pass() -> None:
    crossing = open_task((4, 2), (4, 12), (0, 6), (8, 6))  # both on (4, 6) in step 4
    assert not walked(crossing, "heedless")["success"]
    row = walked(crossing, "wait")
    assert row["success"]
    assert row["length"] == 10.0
    assert row["last"] > 10.0


def test_the_force_pushes_off_what_is_near_and_pulls_on_from_what_is_far() -> None:
    robot = Robot(open_task((4, 4), (4, 12), (0, 0)), make_planner("astar_turns"))
    assert robot.by_field((4, 5), (4, 12), 1.0) == (4, 3)
    # At 3 cells: the push is 60 (1/3 - 1/4) / 9 = 0.56, for n = 1 times 8 to the goal, under the pull of 8.
    assert (GAIN, REACH) == (60.0, 4.0)
    assert robot.by_field((4, 7), (4, 12), 1.0) == (4, 5)
    assert robot.by_field((4, 7), (4, 12), 0.0) == (4, 5)


def test_the_obstacle_is_never_stepped_upon() -> None:
    robot = Robot(open_task((4, 4), (4, 12), (0, 0)), make_planner("astar_turns"))
    for obstacle in ((3, 4), (5, 5), (4, 5)):
        for mode in ("new route", "classical field", "improved field", "improved field, point", "wait"):
            assert MODES[mode](robot, obstacle) != obstacle


def test_rows_of_bodies_depend_on_the_code_that_drives_them() -> None:
    code = _closure(["train.tables.papers.fleet"], DRIVING)
    assert {"agents.rules", "warehouse_env.simulation.step", "train.tables.papers.coordinator"} <= set(code)
