"""Paper 001's coordinator: hand-computed conflicts, what no fleet may ever do, the printed experiment, its verdicts."""

from __future__ import annotations

from itertools import combinations, pairwise
from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from train.tables.catalogue import settings_of, studies_of
from train.tables.papers.coordinator import Coordinator, Path, duration, meet, nearest, path_of
from train.tables.papers.settings import drawn_map
from train.tables.papers.six_agvs import by_bodies, printed_task
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


def test_how_near_two_robots_come_within_a_step() -> None:
    assert nearest((0, 0), (0, 1), (0, 1), (0, 0)) == 0.0  # change places
    assert nearest((0, 0), (1, 1), (0, 1), (1, 0)) == 0.0  # crossing diagonals
    assert nearest((0, 0), (0, 1), (1, 0), (0, 0)) == pytest.approx(sqrt(0.5))  # round a corner
    assert nearest((0, 0), (0, 1), (0, 1), (0, 2)) == 1.0  # one behind the other
    assert nearest((0, 0), (1, 1), (1, 0), (0, 0)) == pytest.approx(sqrt(0.2))  # across a cell that is being left
    assert nearest((0, 0), (0, 0), (3, 4), (3, 4)) == 5.0


def drive(grid: GridMap, *ends: tuple[Cell, Cell]) -> tuple[list[float], list[Path]]:
    """Drive by all rules; all must arrive without a clash."""
    paths, arrived = Coordinator(grid, planned(grid, *ends)).drive()
    assert arrived
    assert clashes(paths) == 0
    return times(paths), paths


def test_at_a_node_the_robot_with_the_longer_way_left_waits_a_step() -> None:
    ends = ((2, 0), (2, 6)), ((0, 2), (4, 2))  # both on (2, 2) in step 2
    assert clashes(planned(open_floor(5, 7), *ends)) == 1
    took, paths = drive(open_floor(5, 7), *ends)
    assert took == [7.0, 4.0]
    assert paths[0][:3] == [(2, 0), (2, 1), (2, 1)]


def test_head_on_it_steps_aside_by_two_diagonals() -> None:
    took, paths = drive(open_floor(3, 9), ((1, 0), (1, 8)), ((1, 6), (1, 0)))  # both on (1, 3) in step 3
    assert took == pytest.approx([8 + 2 * sqrt(2) - 2, 6.0])
    assert paths[0][3][0] != 1  # beside its row


def test_in_an_aisle_it_takes_a_new_route_and_without_one_waits_for_ever() -> None:
    ring = drawn_map(".......\n.#####.\n.......", "ring")
    # Three steps to (0, 3) would meet: it turns back on (0, 2), and comes from below.
    assert drive(ring, ((0, 0), (0, 6)), ((0, 6), (0, 1)))[0] == [2 + 2 + 2 + 6 + 2, 5.0]
    aisle = drawn_map("########\n#......#\n########", "aisle")
    paths, arrived = Coordinator(aisle, planned(aisle, ((1, 1), (1, 6)), ((1, 6), (1, 2)))).drive()
    assert not arrived
    assert clashes(paths) == 0


def test_arrived_robots_are_driven_round() -> None:
    # Down beside it, since a diagonal would cut its corner, two on, and up again by a diagonal.
    assert drive(open_floor(3, 7), ((1, 0), (1, 6)), ((1, 4), (1, 3)))[0] == pytest.approx([2 + 3 + sqrt(2) + 1, 1.0])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 7), st.booleans(), st.booleans())
def test_no_fleet_ever_touches_or_breaks_the_rules_of_the_map(seed: int, robots: int, aside: bool, new: bool) -> None:
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


def test_the_printed_experiment() -> None:
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


def test_bodies_drive_given_tasks_together_and_each_alone() -> None:
    task = TableTask(open_floor(5, 8), (1, 1), (1, 6), (((3, 6), (3, 1)),))
    for alone in (False, True):
        driven = by_bodies(task, make_planner("astar_turns"), np.random.default_rng(0), alone=alone)
        assert driven["success"]
        assert driven["contacts"] == 0
        assert 8.0 < driven["length"] < 13.0
        assert 3.0 < driven["last"] < 20.0


def test_tasks_are_drawn_with_room_for_bodies() -> None:
    for name, setting in settings_of("001", "001_six_agvs").items():
        for task in setting.tasks if name != "as printed" else ():
            starts = np.array([start for start, _ in task.ends])
            assert len({cell for one in task.ends for cell in one}) == 2 * len(starts)
            apart = np.abs(starts[:, None] - starts[None]).max(axis=2)[np.triu_indices(len(starts), 1)]
            assert apart.min() > 1
