"""Who waits for whom and what is done about it: rings, stages, and the page that tells when."""

from __future__ import annotations

import re

import pytest

from tests.pages import PAGES
from tests.simulation.rights import World
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.driver import tracking
from warehouse_env.simulation.state import NOBODY, field_of
from warehouse_env.simulation.traffic import live, pedestrian_yield, waits
from warehouse_env.simulation.traffic.waits import MOVES, SEEKS, STUCK, WAITS


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
def test_a_ring_is_left_once_all_of_it_stand_by_who_has_waited_long_enough(
    waited: list[float], found: list[int]
) -> None:
    assert stages(standing([1, 2, 0], waited)) == found


def test_who_queues_for_a_ring_or_for_one_that_moves_waits() -> None:
    assert stages(standing([1, 0, 0, NOBODY, 3], [3.0, 3.0, 3.0, 0.0, 9.0])) == [SEEKS, SEEKS, WAITS, MOVES, WAITS]


@pytest.mark.parametrize(
    ("waited", "other", "parked", "found"),
    [(4.1, 2.1, False, STUCK), (3.9, 9.0, False, WAITS), (4.1, 1.9, False, WAITS), (4.1, 0.0, True, STUCK)],
)
def test_who_waits_for_one_that_stands_for_good_is_stuck(waited: float, other: float, parked: bool, found: int) -> None:
    world = standing([1, NOBODY], [waited, other])
    world.robots["task"]["alive"][1] = not parked
    assert stages(world)[0] == found


@pytest.mark.parametrize(("field", "value"), [("rules_active", 0.0), ("pause", 1.0)])
def test_who_drives_as_commanded_or_has_just_searched_does_not_search(field: str, value: float) -> None:
    world = standing([1, 0], [9.0, 9.0])
    field_of(world.robots, field)[0] = value
    assert stages(world) == [WAITS, SEEKS]


def test_while_one_makes_room_nobody_else_of_its_ring_does() -> None:
    world = standing([1, 2, 0], [3.0, 3.0, 3.0])
    world.robots["traffic"]["retreating"][1], world.robots["traffic"]["pause"][1] = 1, 5.0
    assert stages(world) == [WAITS, MOVES, WAITS]
    world.robots["traffic"]["pause"][1] = 0.0  # it has not got away
    assert stages(world) == [SEEKS, SEEKS, SEEKS]


def test_only_whoever_could_be_in_a_ring_is_asked_for_whom_it_waits() -> None:
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
        waits.REFUSED, waits.STANDS, pedestrian_yield.KEPT, waits.URGED, waits.SEEKS_AFTER, waits.FOR_GOOD,
        tracking.HELD,
        waits.STUCK_AFTER, tracking.PATIENCE, waits.ROCKS, live.STOOD_FOR, waits.SHUT_IN_AFTER, waits.DEARER,
        EnvConfig.stuck_after,
    )  # fmt: skip
    less_rounding = {0.95: 1.0, 4.95: 5.0}
    told_seconds = [round(float(value), 2) for value in told]
    assert set(seconds[1:]) == {less_rounding.get(value, value) for value in told_seconds}
