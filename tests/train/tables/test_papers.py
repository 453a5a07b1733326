"""Test papers 001 and 002: coordinated robots and moving obstacles, by hand and by property."""

from __future__ import annotations

from itertools import combinations, pairwise
from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from train.reporting.rows import Row
from train.tables.catalogue import settings_of, studies_of
from train.tables.papers import avoidance
from train.tables.papers.coordinator import Coordinator, Path, duration, meet, nearest, path_of, printed_task
from train.tables.papers.settings import drawn_map
from train.tables.study import TableTask
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import make_planner, validate


def planned(grid: GridMap, *ends: tuple[Cell, Cell]) -> list[Path]:
    planner = make_planner("astar_turns")
    return [path_of(planner.plan(grid, *one, np.random.default_rng(0)).cells) for one in ends]


def times(paths: list[Path]) -> list[float]:
    return [duration(path) for path in paths]


def clashes(paths: list[Path]) -> int:
    return sum(meet(*pair) for pair in combinations(paths, 2))


def open_floor(rows: int, columns: int) -> GridMap:
    return GridMap(np.zeros((rows, columns), dtype=np.bool_))


def test_nearest_distance_within_a_step() -> None:
    assert nearest((0, 0), (0, 1), (0, 1), (0, 0)) == 0.0  # swap
    assert nearest((0, 0), (1, 1), (0, 1), (1, 0)) == 0.0  # crossing diagonals
    assert nearest((0, 0), (0, 1), (1, 0), (0, 0)) == pytest.approx(sqrt(0.5))  # round a corner
    assert nearest((0, 0), (0, 1), (0, 1), (0, 2)) == 1.0  # one behind the other
    assert nearest((0, 0), (1, 1), (1, 0), (0, 0)) == pytest.approx(sqrt(0.2))  # across a cell while its robot leaves
    assert nearest((0, 0), (0, 0), (3, 4), (3, 4)) == 5.0


def drive(grid: GridMap, *ends: tuple[Cell, Cell]) -> tuple[list[float], list[Path]]:
    """Drive with all rules; all robots must arrive without contact."""
    paths, arrived = Coordinator(grid, planned(grid, *ends)).drive()
    assert arrived
    assert clashes(paths) == 0
    return times(paths), paths


def test_robot_with_the_longer_way_left_waits_at_a_node() -> None:
    ends = ((2, 0), (2, 6)), ((0, 2), (4, 2))  # both on (2, 2) in step 2
    assert clashes(planned(open_floor(5, 7), *ends)) == 1
    took, paths = drive(open_floor(5, 7), *ends)
    assert took == [7.0, 4.0]
    assert paths[0][:3] == [(2, 0), (2, 1), (2, 1)]


def test_head_on_robot_steps_aside_by_two_diagonals() -> None:
    took, paths = drive(open_floor(3, 9), ((1, 0), (1, 8)), ((1, 6), (1, 0)))  # both on (1, 3) in step 3
    assert took == pytest.approx([8 + 2 * sqrt(2) - 2, 6.0])
    assert paths[0][3][0] != 1  # beside its row


def test_robot_in_an_aisle_takes_a_new_route_or_waits() -> None:
    ring = drawn_map(".......\n.#####.\n.......", "ring")
    # Three steps to (0, 3) would cause contact: the robot turns back on (0, 2) and takes the lower aisle.
    assert drive(ring, ((0, 0), (0, 6)), ((0, 6), (0, 1)))[0] == [2 + 2 + 2 + 6 + 2, 5.0]
    aisle = drawn_map("########\n#......#\n########", "aisle")
    paths, arrived = Coordinator(aisle, planned(aisle, ((1, 1), (1, 6)), ((1, 6), (1, 2)))).drive()
    assert not arrived
    assert clashes(paths) == 0


def test_robots_drive_round_arrived_ones() -> None:
    # Down beside the robot (a diagonal would cut its corner), two ahead, and up by a diagonal.
    assert drive(open_floor(3, 7), ((1, 0), (1, 6)), ((1, 4), (1, 3)))[0] == pytest.approx([2 + 3 + sqrt(2) + 1, 1.0])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 7), st.booleans(), st.booleans())
def test_fleets_avoid_contact_and_make_legal_moves(seed: int, robots: int, aside: bool, new: bool) -> None:
    rng = np.random.default_rng(seed)
    grid = GridMap(rng.random((7, 8)) < 0.25)
    cells = path_of(rng.permutation(grid.free_cells))
    robots = min(robots, len(cells) // 2)
    ends = list(zip(cells[:robots], cells[robots : 2 * robots], strict=True))
    paths, arrived = Coordinator(grid, planned(grid, *ends), aside=aside, new_route=new).drive()
    assert clashes(paths) == 0
    for path, (start, goal) in zip(paths, ends, strict=True):
        moved = [path[0], *(b for a, b in pairwise(path) if a != b)]
        validate(grid, moved, start, goal if arrived else moved[-1])


def test_printed_experiment_is_reproduced() -> None:
    task = printed_task()
    alone = planned(task.grid, *task.ends)
    for paths, line in zip(
        (alone, drive(task.grid, *task.ends)[1]), studies_of("001")["001_six_agvs"].printed, strict=True
    ):
        assert {"mean": sum(times(paths)), "last": max(times(paths))} == pytest.approx(line.figures, abs=5e-5)
    assert task.grid.shape[1] == 22
    assert clashes(alone) == 2
    at = [path[9] for path in alone]
    assert at[0] == at[4]
    assert at[2] == at[5]
    assert alone[2][8] == alone[5][10]  # head-on
    left = [duration(alone[robot][9:]) for robot in (0, 4, 2, 5)]
    assert left == pytest.approx([12.4142, 3.4142, 11.8284, 17.8284], abs=5e-5)


def test_drawn_tasks_begin_two_cells_apart() -> None:
    for name, setting in settings_of("001", "001_six_agvs").items():
        for task in setting.tasks if name != "as printed" else ():
            starts = np.array([start for start, _ in task.ends])
            assert len({cell for one in task.ends for cell in one}) == 2 * len(starts)
            apart = np.abs(starts[:, None] - starts[None]).max(axis=2)[np.triu_indices(len(starts), 1)]
            assert apart.min() > 1


def open_task(start: Cell, goal: Cell, *obstacle: Cell) -> TableTask:
    return TableTask(GridMap(np.zeros((9, 13), dtype=np.bool_)), start, goal, ((obstacle[0], obstacle[-1]),))


def walked(task: TableTask, label: str) -> Row:
    return avoidance.avoid(task, make_planner("astar_turns"), np.random.default_rng(0), answer=avoidance.ANSWERS[label])


def test_meeting_step_by_hand() -> None:
    assert avoidance.met_at([(0, 0), (0, 1), (0, 2)], [(0, 3), (0, 2), (0, 1)]) == 1  # swap
    assert avoidance.met_at([(0, 0), (0, 1), (0, 2)], [(2, 1), (1, 1), (0, 1)]) is None  # one behind the other
    assert avoidance.met_at([(0, 0), (0, 1)], [(0, 2), (0, 1)]) == 0


def test_obstacle_tasks_hit_robots_that_ignore_them() -> None:
    planner = make_planner("astar_turns")
    for seed in range(4):
        for kind, task in avoidance.obstacles(seed).items():
            path, other = (avoidance.cells_of(planner, task.grid, *one) for one in task.ends)
            step, shared = avoidance.met_at(path, other), len(set(path) & set(other))
            assert (step is None) == (kind == avoidance.STANDING)
            assert step is None or len(path) // 4 <= step < 3 * len(path) // 4
            assert {avoidance.STANDING: shared == 1, avoidance.CROSSING: shared <= 1, avoidance.ONCOMING: shared > 4}[
                kind
            ]
            touched = walked(task, "follows its path")
            assert touched["contacts"]
            assert not touched["success"]


def test_answers_to_oncoming_standing_and_crossing_obstacles() -> None:
    head_on, stands = open_task((4, 0), (4, 12), (4, 12), (4, 0)), open_task((4, 0), (4, 12), (4, 6))
    assert not walked(head_on, "waits")["success"]
    assert walked(head_on, "new route")["success"]
    row = walked(stands, "new route")
    assert row["apart"] == 2.0  # also clear of its neighbours
    # Three cells to the replanning, a diagonal, one up beside the corner, four along, two diagonals, two ahead.
    assert row["length"] == pytest.approx(10 + 3 * 2**0.5)
    assert not walked(stands, "waits")["success"]
    crossing = walked(open_task((4, 2), (4, 12), (0, 6), (8, 6)), "waits")  # both on (4, 6) in step 4
    assert crossing["success"]
    assert crossing["length"] == 10.0
    assert crossing["last"] > 10.0


def test_force_repels_nearby_and_attracts_afar() -> None:
    robot = avoidance.Avoider(open_task((4, 4), (4, 12), (0, 0)), make_planner("astar_turns"))
    assert robot.pushed((4, 5), (4, 12), 1.0) == (4, 3)
    # At 3 cells the push is 60 (1/3 - 1/4) / 9 = 0.56, times 8 to the goal for n = 1, below the pull of 8.
    assert (avoidance.GAIN, avoidance.REACH) == (60.0, 4.0)
    assert robot.pushed((4, 7), (4, 12), 1.0) == robot.pushed((4, 7), (4, 12), 0.0) == (4, 5)


@pytest.mark.parametrize("label", [label for label in avoidance.ANSWERS if label != "follows its path"])
def test_robot_never_steps_onto_the_obstacle(label: str) -> None:
    robot = avoidance.Avoider(open_task((4, 4), (4, 12), (0, 0)), make_planner("astar_turns"))
    for obstacle in ((3, 4), (5, 5), (4, 5)):
        assert avoidance.ANSWERS[label](robot, obstacle) != obstacle
