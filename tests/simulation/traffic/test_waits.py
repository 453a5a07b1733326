"""Who waits for whom and what is done about it: by hand, cycles against a plain walk, the page that tells when."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.pages import PAGES
from tests.simulation.rights import World
from tests.simulation.worlds import Pose, room, stage, write
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.driver import tracking
from warehouse_env.simulation.record.waiting import WaitingRecord, why_it_waits
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import NOBODY, ROBOT, field_of
from warehouse_env.simulation.traffic import live, waits
from warehouse_env.simulation.traffic.waits import MOVES, SEEKS, STUCK, WAITS, find_wait_cycles


def standing(yields_to: list[int], waited: list[float]) -> World:
    """Robots in a row, far enough apart, which have agreed on who goes first and have stood for some time [s]."""
    world = World(*((2.0 + 3.0 * k, 10.0, 0.0) for k in range(len(waited))))
    world.robots["traffic"]["rules_active"] = 1.0
    world.robots["traffic"]["yields_to"], world.robots["clocks"]["waiting_time"] = yields_to, waited
    return world


def stages(world: World) -> list[int]:
    found = waits.scratch(len(world.robots))
    count = waits.look(world.robots, found)
    assert count == (found[waits.STAGE] > WAITS).sum()
    return [int(stage) for stage in found[waits.STAGE]]


@pytest.mark.parametrize(
    ("waited", "found"),
    [
        ([0.9, 3.0, 3.0], [MOVES, WAITS, WAITS]),  # one of the ring moves
        ([1.0, 1.9, 2.0], [WAITS, WAITS, SEEKS]),
        ([3.0, 3.0, 3.0], [SEEKS, SEEKS, SEEKS]),
    ],
)
def test_a_robot_leaves_a_wait_cycle_once_all_of_it_have_waited(waited: list[float], found: list[int]) -> None:
    assert stages(standing([1, 2, 0], waited)) == found


def test_robots_that_queue_for_a_cycle_or_a_moving_robot_wait() -> None:
    assert stages(standing([1, 0, 0, NOBODY, 3], [3.0, 3.0, 3.0, 0.0, 9.0])) == [SEEKS, SEEKS, WAITS, MOVES, WAITS]


@pytest.mark.parametrize(
    ("waited", "other", "parked", "found"),
    [(4.1, 2.1, False, STUCK), (3.9, 9.0, False, WAITS), (4.1, 1.9, False, WAITS), (4.1, 0.0, True, STUCK)],
)
def test_behind_a_permanently_standing_robot_it_is_stuck(waited: float, other: float, parked: bool, found: int) -> None:
    world = standing([1, NOBODY], [waited, other])
    world.robots["task"]["alive"][1] = not parked
    assert stages(world)[0] == found


@pytest.mark.parametrize(("field", "value"), [("rules_active", 0.0), ("pause", 1.0)])
def test_robots_that_drive_or_have_just_searched_do_not_search(field: str, value: float) -> None:
    world = standing([1, 0], [9.0, 9.0])
    field_of(world.robots, field)[0] = value
    assert stages(world) == [WAITS, SEEKS]


def test_only_one_robot_of_a_wait_cycle_retreats_at_a_time() -> None:
    world = standing([1, 2, 0], [3.0, 3.0, 3.0])
    world.robots["traffic"]["retreating"][1], world.robots["traffic"]["pause"][1] = 1, 5.0
    assert stages(world) == [WAITS, MOVES, WAITS]
    world.robots["traffic"]["pause"][1] = 0.0  # it has not got away
    assert stages(world) == [SEEKS, SEEKS, SEEKS]


def test_waits_are_looked_up_only_for_robots_that_may_be_in_a_cycle() -> None:
    world = standing([NOBODY] * 4, [9.0] * 4)
    world.robots["shield"]["vetoed_by"], world.robots["clocks"]["standing_time"] = [1, 2, 1, 0], [0.0, 3.0, 0.0, 0.0]
    found = waits.scratch(4)
    waits.find_wait_cycles_of(
        world.robots, world.simulator.routes[0], 3.0, 15.0, found, world.simulator._params[0], None
    )
    assert found[waits.WHO].tolist() == [NOBODY, 2, 1, NOBODY]
    assert found[waits.CYCLE].tolist() == [NOBODY, 1, 1, NOBODY]


def rows() -> list[list[str]]:
    """The cells of each row of the page's table of who steps in when."""
    table = PAGES["docs/traffic.md"].split("## Who steps in when")[1].split("\n## ")[0]
    lines = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| ")]
    return lines[2:]


def test_the_page_tells_in_order_when_what_happens() -> None:
    seconds = [float(found[0]) for row in rows() if (found := re.match(r"[\d.]+", row[0])) is not None]
    assert seconds == sorted(seconds)
    told = (
        waits.REFUSED, waits.STANDS, waits.KEPT, waits.URGED, waits.SEEKS_AFTER, waits.PERMANENT,
        tracking.HELD,
        waits.STUCK_AFTER, tracking.PATIENCE, waits.ROCKS, live.STOOD_FOR, waits.SHUT_IN_AFTER, waits.DEARER,
        EnvConfig.stuck_after,
    )  # fmt: skip
    less_rounding = {0.95: 1.0, 4.95: 5.0}
    told_seconds = [round(float(value), 2) for value in told]
    assert set(seconds[1:]) == {less_rounding.get(value, value) for value in told_seconds}


EAST, NORTH, WEST, SOUTH = 0.0, math.pi / 2, math.pi, -math.pi / 2


def on_routes(*poses: Pose, goals: list[tuple[int, int]], seconds: float = 1.0) -> Simulator:
    """Robots that have stood for some time on a room of 12 x 12, each with a straight route from its cell to a goal."""
    simulator = stage(room(12, 12), *poses, keep_right=0.0)
    for robot, (pose, goal) in enumerate(zip(poses, goals, strict=True)):
        start = tuple(simulator.grid.cell(np.array(pose[:2])).tolist())
        simulator.dispatcher.give_task(0, robot, goal, simulator.route_book.route(start, goal))
    simulator.robots["clocks"]["waiting_time"] = seconds
    return simulator


def waits_for(simulator: Simulator) -> list[int]:
    return simulator.jams().waits_for[0].tolist()


# Front axles in the middle of row 5 from the south (y = 5.5); cell (6, c) of 12 rows is that row.
QUEUE = [(2.5, 5.5, EAST), (4.5, 5.5, EAST), (8.5, 5.5, EAST)]


def test_only_standing_robots_wait() -> None:
    assert waits_for(on_routes(*QUEUE, goals=[(6, 10), (6, 11), (6, 9)], seconds=0.8)) == [NOBODY] * 3
    simulator = on_routes(*QUEUE, goals=[(6, 10), (6, 11), (6, 9)], seconds=0.0)
    simulator.robots["clocks"]["standing_time"] = 5.0  # rocks where it is
    assert waits_for(simulator)[0] == 1
    simulator.robots[0, 0]["task"]["alive"] = 0
    assert waits_for(simulator)[0] == NOBODY


@pytest.mark.parametrize(("refused_by", "yields_to", "answer"), [(2, NOBODY, 2), (NOBODY, 2, 2), (2, 1, 2)])
def test_a_robot_waits_for_the_one_that_vetoes_it_or_goes_first(refused_by: int, yields_to: int, answer: int) -> None:
    simulator = on_routes(*QUEUE, goals=[(6, 10), (6, 11), (6, 9)])
    write(simulator.robots[0, 0], vetoed_by=refused_by, yields_to=yields_to)
    assert waits_for(simulator) == [answer, NOBODY, NOBODY]
    simulator.robots["clocks"]["waiting_time"] = 0.0  # a driving robot waits for nobody
    assert waits_for(simulator) == [NOBODY] * 3


CROSSING = [(5.2, 5.5, EAST), (6.5, 5.2, NORTH), (6.8, 6.5, WEST), (5.5, 6.8, SOUTH)]  # each before the next flank
STANDING: dict[str, tuple[list[Pose], list[tuple[int, int]], list[int]]] = {  # poses, goals, waits
    "a queue": (QUEUE, [(6, 10), (6, 11), (6, 9)], [1, NOBODY, NOBODY]),  # 1.1 m before the first, 3.1 m: too far
    "a goal before the other body": (QUEUE[:2], [(6, 3), (6, 10)], [NOBODY, NOBODY]),  # 1 m ahead, 0.1 m are left
    "a body 1 cm beside the way": ([(2.5, 5.5, EAST), (4.5, 6.11, EAST)], [(6, 10), (5, 10)], [NOBODY, NOBODY]),
    "a body 1 cm in the way": ([(2.5, 5.5, EAST), (4.5, 6.09, EAST)], [(6, 10), (5, 10)], [1, NOBODY]),
    "the first of two": (
        [(2.5, 5.5, EAST), (5.2, 5.5, NORTH), (4.2, 5.5, SOUTH)], [(6, 10), (0, 5), (11, 4)], [2, NOBODY, NOBODY]
    ),
    "four around a point": (CROSSING, [(6, 11), (0, 6), (5, 0), (11, 5)], [1, 2, 3, 0]),
    "nose to nose": ([(4.5, 5.5, EAST), (5.5, 5.5, WEST)], [(6, 10), (6, 0)], [1, 0]),
}  # fmt: skip


@pytest.mark.parametrize("case", STANDING)
def test_the_first_body_along_its_way_is_waited_for(case: str) -> None:
    poses, goals, answer = STANDING[case]
    simulator = on_routes(*poses, goals=goals)
    assert waits_for(simulator) == answer
    assert (simulator.jams().cycle[0] == (NOBODY if NOBODY in answer else 0)).all()


def plain_cycles(waits_for: list[int]) -> list[int]:
    """For each robot: walk on; whoever comes back to itself is on a cycle, named by its lowest member."""
    result = []
    for robot in range(len(waits_for)):
        walk, at = [], waits_for[robot]
        while at != NOBODY and at != robot and at not in walk:
            walk.append(at)
            at = waits_for[at]
        result.append(min([robot, *walk]) if at == robot else NOBODY)
    return result


@given(st.integers(1, 9).flatmap(lambda n: st.lists(st.integers(NOBODY, n - 1), min_size=n, max_size=n)))
def test_cycles_are_those_of_a_plain_walk(waits_for: list[int]) -> None:
    who = np.array(waits_for, dtype=np.int32)
    found = np.empty_like(who)
    find_wait_cycles(who, found, np.empty(len(who), np.int64))
    assert found.tolist() == plain_cycles(waits_for)


def deadlocks(waits_at: range, end: Any = None) -> int:
    """Count deadlocks of two robots nose to nose that wait at these steps of 0.1 s; `end(simulator)` is done at 6 s."""
    simulator = on_routes((4.5, 5.5, EAST), (5.5, 5.5, WEST), goals=[(6, 10), (6, 0)])
    record = WaitingRecord(simulator)
    for step in range(1, 91):
        simulator.robots["clocks"]["waiting_time"] = 1.0 if step in waits_at else 0.0
        if step == 60 and end is not None:
            end(simulator)
        record(simulator, step)
    return record.deadlocks[0]


def away_and_back(simulator: Simulator) -> None:
    """Move a robot away for one look."""
    simulator.robots[0, 1]["motion"]["x"] += 1.01


def goal(simulator: Simulator) -> None:
    simulator.robots[0, 1]["totals"]["goals"] += 1


def test_a_deadlock_counts_once_until_a_member_gets_away() -> None:
    assert deadlocks(range(20, 31)) == 1
    assert deadlocks(range(20, 91)) == 1
    assert deadlocks(range(20, 91), goal) == 2
    assert deadlocks(range(20, 91, 20)) == 0  # a cycle of one look is no deadlock
    assert deadlocks(range(20, 91), away_and_back) == 2


@given(st.integers(1, 9).flatmap(lambda n: st.lists(st.integers(NOBODY, n - 1), min_size=n, max_size=n)))
def test_a_chain_is_told_to_its_end(waits_for: list[int]) -> None:
    robots = np.zeros(len(waits_for), ROBOT)
    robots["task"]["alive"] = 1
    told = why_it_waits(0, np.array(waits_for, np.int32), robots)
    named = [0, *(int(word) for word in re.findall(r"waits for (\d+)", told))]
    assert all(waits_for[one] == other for one, other in pairwise(named))
    in_cycle = named[-1] in named[:-1]
    assert told.endswith(": a wait cycle" if in_cycle else "stands by itself")
    assert in_cycle or waits_for[named[-1]] == NOBODY


def test_why_a_robot_stands() -> None:
    robots = np.zeros(4, ROBOT)
    robots["task"]["alive"] = 1, 1, 1, 0
    robots["motion"]["speed"] = 0, 0, 0.5, 0
    said = [why_it_waits(0, np.array(who, np.int32), robots) for who in ((1, 2, -1, -1), (3, -1, -1, -1), (1, 0, 0, 0))]
    assert said == [
        "robot 0 waits for 1, which waits for 2, which drives",
        "robot 0 waits for 3, which is parked",
        "robot 0 waits for 1, which waits for 0: a wait cycle",
    ]


def test_the_longest_stand_is_kept_with_its_chain() -> None:
    simulator = on_routes((4.5, 5.5, EAST), (5.5, 5.5, WEST), goals=[(6, 10), (6, 0)])
    record, clocks = WaitingRecord(simulator), simulator.robots["clocks"][0]
    for step, standing in ((5, 50.0), (10, 40.0), (20, 30.0)):  # it looks at every tenth step
        clocks["standing_time"], clocks["waiting_time"] = (standing, standing - 1), 2.0
        record(simulator, step)
    kept = (40.0, "robot 0 waits for 1, which waits for 0: a wait cycle")
    assert record.longest[0] == kept
    simulator.robots["motion"]["speed"] = 0.5  # they get away from each other
    clocks["standing_time"], clocks["waiting_time"] = 45.0, 0.0
    simulator.robots["motion"]["x"] += (-5.0, 5.0)
    record(simulator, 30)
    assert record.longest[0] == kept


def test_standing_counts_rocking_within_a_metre() -> None:
    simulator = stage(room(12, 12), (4.5, 5.5, EAST))
    r = simulator.robots[0, 0]
    r["clocks"]["anchor_x"], r["clocks"]["anchor_y"] = 4.5, 5.5
    for step in range(60):  # to and fro, 0.5 m/s at most
        simulator.step(np.array([[[1.0 if step // 10 % 4 in (0, 3) else -1.0, 0.0]]], dtype=np.float32) * 0.4)
    assert r["totals"]["longest_standing"] == pytest.approx(6.0, abs=0.01)
    for _ in range(40):
        simulator.step(np.array([[[1.0, 0.0]]], dtype=np.float32))
    assert r["clocks"]["standing_time"] < 2.0
    assert r["totals"]["longest_standing"] < 8.5
