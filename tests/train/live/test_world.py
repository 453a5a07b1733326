"""A world that is changed while it runs: what continues, what restarts, what is refused, and that it repeats."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from tests.train.live.worlds import world
from train.kinds import KindPart, Kinds
from train.live.commands import Leave, Make, Person, Shelves
from train.live.world import Change, World
from warehouse_env.config import RobotSpec
from warehouse_env.errors import WarehouseError


def driven(steps: int, changes: Mapping[int, Change], **setting: object) -> World:
    """Return a world after so many steps, changed before some of them."""
    one = world(**setting)
    for step in range(steps):
        if step in changes:
            one.change(changes[step])
        one.step()
    return one


def free_cell_far_off(one: World, metres: float = 4.0) -> tuple[int, int]:
    """Return a free cell of no use to anybody: off all robots, endpoints and goals."""
    cells = one.grid.free_cells
    ends = {tuple(cell) for cell in np.concatenate([one.grid.picks, one.grid.stations]).tolist()}
    points, pose = one.grid.centre(cells), one.simulator.state.pose[0]
    far = np.hypot(points[:, :1] - pose[:, 0], points[:, 1:] - pose[:, 1]).min(axis=1) > metres
    return next((r, c) for r, c in cells[far].tolist() if (r, c) not in ends)


def test_the_same_commands_at_the_same_steps_give_the_same_bits() -> None:
    shelf = free_cell_far_off(driven(30, {}))
    person = free_cell_far_off(driven(50, {30: Shelves((shelf,), True)}))
    changes: dict[int, Change] = {
        30: Shelves((shelf,), True), 50: Person(person), 80: Make(policy="brake"), 110: Leave(0),
        120: Shelves((shelf,), False),
    }  # fmt: skip
    one, again = driven(130, changes), driven(130, changes)
    assert one.digest == again.digest
    assert one.made == 6
    assert driven(130, changes | {110: Make(policy="greedy")}).digest != one.digest


def test_the_world_continues_with_a_new_shelf_before_a_robot() -> None:
    one = driven(25, {})
    state = one.simulator.state
    robot = int(np.argmax(state.speed[0]))
    x, y, heading = state.pose[0, robot].tolist()
    assert state.speed[0, robot] > 1.0
    ahead = one.grid.cell(np.array([x + 1.3 * np.cos(heading), y + 1.3 * np.sin(heading)]))
    before = one.moment()
    assert not one.change(Shelves((tuple(ahead.tolist()),), True))
    assert one.grid.occupied[tuple(ahead)]
    assert one.simulator.state.speed[0, robot] == 0  # it could not stop in time
    for name in ("pose", "goal", "totals"):
        np.testing.assert_array_equal(one.moment()[name], before[name])
    assert (one.steps, one.seconds) == (25, pytest.approx(2.5))
    for _ in range(400):
        one.step()
    goals, contacts, _ = one.moment()["totals"]
    assert goals > before["totals"][0]
    assert contacts == 0


def test_shelves_are_refused_where_robots_are_or_go() -> None:
    one, same = driven(40, {}), driven(40, {})
    pose, goal = one.simulator.state.pose[0, 2], one.simulator.state.goal[0, 1]
    under = tuple(one.grid.cell(pose[:2]).tolist())
    theirs = tuple(goal.tolist())
    for cell, why in ((under, "robot 2"), (theirs, "goal of robot 1"), ((-1, 0), "no cell"), ((0, 99), "no cell")):
        with pytest.raises(WarehouseError, match=why):
            one.change(Shelves((cell,), True))
    every = tuple((int(r), int(c)) for r, c in one.grid.stations)
    with pytest.raises(WarehouseError, match="could reach no station"):
        one.change(Shelves(every, True))
    for _ in range(20):
        one.step()
        same.step()
    assert one.digest == same.digest  # nothing was touched


def test_people_come_and_go() -> None:
    one = driven(10, {})
    cell = free_cell_far_off(one)
    robot = tuple(one.grid.cell(one.simulator.state.pose[0, 0, :2]).tolist())
    for wrong, why in ((robot, "robot 0 is within 2 m"), ((99, 0), "outside")):
        with pytest.raises(WarehouseError, match=why):
            one.change(Person(wrong))
    assert not one.change(Person(cell))
    people = one.moment()["people"]
    np.testing.assert_allclose(people[0, :2], one.grid.centre(np.array(cell)), atol=1e-5)
    with pytest.raises(WarehouseError, match="somebody stands there"):
        one.change(Shelves((cell,), True))
    for _ in range(60):
        one.step()
    assert np.hypot(*(one.moment()["people"][0, :2] - people[0, :2])) > 0.5  # the person walks
    with pytest.raises(WarehouseError, match="no person 1 among 1"):
        one.change(Leave(1))
    one.change(Leave(0))
    assert one.simulator.config.people == 0


def test_a_policy_continues_the_world_and_other_settings_restart_it() -> None:
    one = driven(60, {})
    pose = one.moment()["pose"]
    assert not one.change(Make(policy="brake"))
    np.testing.assert_array_equal(one.moment()["pose"], pose)
    assert one.steps == 60
    assert one.change(Make(robots=6))
    assert (one.steps, len(one.moment()["pose"])) == (0, 6)
    assert one.change(Make(floor="paper46", seed=3))
    assert one.grid.name == "paper46"
    assert one.setting.seed == 3
    assert one.setting.policy == "brake"


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (Make(policy="agents/weights/ppo"), "unknown policy"),
        (Make(floor="aisles:seed=7"), "unknown floor"),
        (Make(floor="/etc/passwd"), "unknown floor"),
        (Make(floor="open", robots=256), "num_agents=256"),
    ],
)
def test_impossible_settings_are_refused(change: Make, why: str) -> None:
    one = driven(1, {})
    with pytest.raises(WarehouseError, match=why):
        one.change(change)
    assert one.made == 1


def test_robots_in_their_bends_touch_nothing_when_the_world_goes_on() -> None:
    """The protective field counts on the wheels as they are: were they put straight, robots would leave their bends."""
    one = world(floor="paper46", robots=24)
    for k in range(150):
        one.step()
        if k % 10 == 9:
            one.change(Make(policy="greedy"))
    assert one.moment()["totals"][1] == 0


@pytest.mark.filterwarnings("ignore::warehouse_env.errors.MapWarning")
def test_shelves_on_floors_for_other_kinds_of_robots() -> None:
    one = driven(5, {}, kinds=Kinds((KindPart(RobotSpec(length=1.2, width=1.2), share=1.0),)))
    assert one.grid.tight is not None  # beside walls
    before, cell = one.grid.endpoints, free_cell_far_off(one)
    one.change(Shelves((cell,), True))
    assert one.grid.tight[cell[0], cell[1] + 1]
    one.change(Shelves((cell,), False))
    assert one.grid.endpoints == before
    one.change(Make(robots=3))
    assert [robot.width for robot in one.simulator.config.robots] == [1.2] * 3
