"""Paper 001's coordinator: hand-computed conflicts, what no fleet may ever do, and the printed experiment."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from train.tables.maps import drawn_map
from train.tables.measures import Figures
from train.tables.papers.coordinator import TOUCH, Coordinator, Driven, clash, drive_alone, duration, nearest
from train.tables.papers.fleet import ALONE, BODIES, BODIES_ALONE, drive_fleet
from train.tables.papers.six_agvs import DRAWS, LENGTH, OURS, PLANNED, TIME, cost_is_small, printed_task, resolves_all
from train.tables.papers.six_agvs import settings as six_settings
from train.tables.study import FAILS, HOLDS, IN_PART, OPEN, System, TableTask
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning import make_planner, validate
from warehouse_env.traffic.conflicts import Route

ROOT2 = math.sqrt(2.0)


def line(*cells: tuple[int, int]) -> Route:
    """A route through the corners given, straight or diagonal between them."""
    path = [cells[0]]
    for row, column in cells[1:]:
        while path[-1] != (row, column):
            at = path[-1]
            path.append((at[0] + int(np.sign(row - at[0])), at[1] + int(np.sign(column - at[1]))))
    return np.array(path, dtype=np.int64)


def times(driven: Driven) -> list[float]:
    return [duration(path) for path in driven.paths()]


def open_floor(rows: int, columns: int) -> GridMap:
    return GridMap(np.zeros((rows, columns), dtype=np.bool_))


def test_how_near_two_come_within_a_step() -> None:
    assert nearest((0, 0), (0, 1), (0, 1), (0, 0)) == 0.0  # change places
    assert nearest((0, 0), (1, 1), (0, 1), (1, 0)) == 0.0  # crossing diagonals
    assert nearest((0, 0), (0, 1), (0, 2), (0, 1)) == 0.0  # one cell
    assert nearest((0, 0), (0, 1), (1, 0), (0, 0)) == pytest.approx(math.sqrt(0.5))  # round a corner
    assert nearest((0, 0), (0, 1), (0, 1), (0, 2)) == 1.0  # one behind the other
    assert nearest((0, 0), (0, 0), (3, 4), (3, 4)) == 5.0
    assert clash((0, 0), (1, 1), (1, 0), (0, 0))  # swings across a cell that is being left: sqrt(0.2)
    assert not clash((0, 0), (0, 1), (1, 0), (0, 0))


steps = st.tuples(*[st.integers(-4, 4)] * 4, *[st.integers(-1, 1)] * 4)


@given(steps)
def test_clashes_are_mutual_and_those_of_the_distance(step: tuple[int, ...]) -> None:
    a, b = (step[0], step[1]), (step[2], step[3])
    to_a, to_b = (a[0] + step[4], a[1] + step[5]), (b[0] + step[6], b[1] + step[7])
    assert clash(a, to_a, b, to_b) == clash(b, to_b, a, to_a) == (nearest(a, to_a, b, to_b) < TOUCH)


def test_at_a_node_the_one_with_the_longer_way_left_waits_a_step() -> None:
    routes = [line((2, 0), (2, 6)), line((0, 2), (4, 2))]  # both on (2, 2) in step 2
    assert drive_alone(routes).clashes() == 1
    driven = Coordinator().drive(open_floor(5, 7), routes)
    assert driven.arrived
    assert driven.clashes() == 0
    assert times(driven) == [7.0, 4.0]
    assert driven.tracks[:3, 0].tolist() == [[2, 0], [2, 1], [2, 1]]


def test_head_on_the_one_with_the_longer_way_left_steps_aside_by_two_diagonals() -> None:
    routes = [line((1, 0), (1, 8)), line((1, 6), (1, 0))]  # both on (1, 3) in step 3
    driven = Coordinator().drive(open_floor(3, 9), routes)
    assert driven.arrived
    assert times(driven) == pytest.approx([8 + 2 * ROOT2 - 2, 6.0])
    assert driven.tracks[3, 0, 0] != 1  # beside its row


def test_in_an_aisle_it_takes_a_new_route_and_without_one_waits_for_ever() -> None:
    ring = drawn_map(".......\n.#####.\n.......", "ring")
    routes = [line((0, 0), (0, 6)), line((0, 6), (0, 1))]
    driven = Coordinator().drive(ring, routes)
    assert driven.arrived
    # Three steps to (0, 3) would meet: it turns back on (0, 2), and comes from below.
    assert times(driven) == [2 + 2 + 2 + 6 + 2, 5.0]
    aisle = drawn_map("########\n#......#\n########", "aisle")
    stuck = Coordinator().drive(aisle, [line((1, 1), (1, 6)), line((1, 6), (1, 2))])
    assert not stuck.arrived
    assert stuck.clashes() == 0


def test_who_has_arrived_is_driven_round() -> None:
    driven = Coordinator().drive(open_floor(3, 7), [line((1, 0), (1, 6)), line((1, 4), (1, 3))])
    assert driven.arrived
    # Down beside it, since a diagonal would cut its corner, two on, and up again by a diagonal.
    assert times(driven) == pytest.approx([2 + 3 + ROOT2 + 1, 1.0])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 7), st.booleans(), st.booleans())
def test_no_fleet_ever_touches_or_leaves_the_rules_of_the_map(seed: int, robots: int, aside: bool, new: bool) -> None:
    rng = np.random.default_rng(seed)
    grid = GridMap(rng.random((7, 8)) < 0.25)
    cells = [(int(row), int(column)) for row, column in rng.permutation(grid.free_cells)]
    robots = min(robots, len(cells) // 2)
    ends = list(zip(cells[:robots], cells[robots : 2 * robots], strict=True))
    routes = [make_planner("astar_turns").plan(grid, *one, rng).cells for one in ends]
    if not routes:
        return
    driven = Coordinator(aside, new).drive(grid, routes)
    assert driven.clashes() == 0
    for path, (start, goal) in zip(driven.paths(), ends, strict=True):
        moved = [path[0], *(b for a, b in pairwise(path) if a != b)]
        validate(grid, moved, start, goal if driven.arrived else moved[-1])


def test_the_printed_experiment() -> None:
    task = printed_task()
    ends = ((task.start, task.goal), *task.others)
    routes = [make_planner("astar_turns").plan(task.grid, *one, np.random.default_rng(0)).cells for one in ends]
    alone = drive_alone(routes)
    assert task.grid.shape[1] == 22
    assert sum(times(alone)) == pytest.approx(LENGTH[0], abs=5e-5)
    assert max(times(alone)) == times(alone)[5] == pytest.approx(TIME[0], abs=5e-5)
    assert alone.clashes() == 2
    at = alone.tracks[9].tolist()
    assert at[0] == at[4]
    assert at[2] == at[5]
    assert alone.tracks[8, 2].tolist() == alone.tracks[10, 5].tolist()  # head-on
    left = [duration(alone.paths()[robot][9:]) for robot in (0, 4, 2, 5)]
    assert left == pytest.approx([12.4142, 3.4142, 11.8284, 17.8284], abs=5e-5)
    ours = Coordinator().drive(task.grid, routes)
    assert sum(times(ours)) == pytest.approx(LENGTH[1], abs=5e-5)
    assert max(times(ours)) == pytest.approx(TIME[1], abs=5e-5)
    waited = [own - before for own, before in zip(times(ours), times(alone), strict=True)]
    assert waited == pytest.approx([1, 0, 0, 0, 0, 2 * ROOT2 - 2])


def test_tasks_are_drawn_with_room_for_bodies() -> None:
    for setting in six_settings()[1:]:
        assert len(setting.tasks) == DRAWS
        for task in setting.tasks:
            ends = ((task.start, task.goal), *task.others)
            starts = [start for start, _ in ends]
            assert len({*starts, *(goal for _, goal in ends)}) == 2 * len(ends)
            apart = [max(abs(a[0] - b[0]), abs(a[1] - b[1])) for k, a in enumerate(starts) for b in starts[:k]]
            assert min(apart) > 1


def row(setting: str, system: str, number: int, length: float | None, contacts: int = 0) -> dict[str, object]:
    return {"study": "x", "setting": setting, "system": system, "number": number, "length": length,
            "success": length is not None, "contacts": contacts}  # fmt: skip


def test_a_cost_is_judged_by_the_upper_end_of_its_interval() -> None:
    def verdict(*costs: float) -> tuple[str, str]:
        rows = [row("a", PLANNED, k, 100.0) for k in range(len(costs))]
        rows += [row("a", OURS, k, 100.0 * (1 + cost)) for k, cost in enumerate(costs)]
        found = cost_is_small(Figures("x", rows), OURS, PLANNED, "mean", 0.015, ("a", "absent"))
        return found.word, found.why

    assert verdict(0.015) == (HOLDS, "a: +1.5%")
    assert verdict(0.016)[0] == FAILS
    assert verdict(0.01, 0.011, 0.012)[0] == HOLDS
    assert verdict(0.0, 0.0, 0.03)[0] == FAILS  # mean 1%, but not told from 5%
    assert cost_is_small(Figures("x", []), OURS, PLANNED, "mean", 0.015).word == OPEN


def test_all_must_arrive_untouched() -> None:
    rows = [row("a", OURS, 0, 9.0), row("a", OURS, 1, 9.0), row("b", OURS, 0, 9.0), row("b", OURS, 1, None)]
    assert resolves_all(Figures("x", rows), OURS, ("a",)).word == HOLDS
    assert resolves_all(Figures("x", rows), OURS, ("a", "b")) == (IN_PART, "a: 2 of 2; b: 1 of 2", False)
    assert resolves_all(Figures("x", [row("a", OURS, 0, 9.0, contacts=1)]), OURS, ("a",)).word == FAILS
    assert resolves_all(Figures("x", []), OURS).word == OPEN


def test_bodies_drive_given_tasks_together_and_each_alone() -> None:
    task = TableTask(open_floor(7, 12), (1, 1), (1, 9), (((5, 9), (5, 1)),))
    rows = {
        mode: drive_fleet(task, System(mode, "astar_turns", mode=mode), np.random.default_rng(0))
        for mode in (ALONE, BODIES, BODIES_ALONE)
    }
    assert rows[ALONE]["length"] == 16.0
    for mode in (BODIES, BODIES_ALONE):
        assert rows[mode]["success"]
        assert rows[mode]["contacts"] == 0
        assert 14.0 < rows[mode]["length"] < 20.0
        assert 4.0 < rows[mode]["last"] < 30.0
