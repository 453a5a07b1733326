"""Aisles of one cell, and what a robot foresees of those who come along them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.simulation.worlds import drawn, lay, stage, write
from warehouse_env.config import SensorSpec
from warehouse_env.simulation.physics.floor import floor_of
from warehouse_env.simulation.senses.passages import passages_of
from warehouse_env.simulation.simulator import Simulator

BACK, STAND, FAST = range(3)
FLOOR = drawn(
    [
        "......##############......",
        "......##.###########......",
        "......##.###########......",
        "..........................",  # y from 4 to 5
        "......#####.########......",
        "......#####.########......",
        "............########......",
        "......##############......",
    ]
)  # fmt: skip
AISLE = 4.5  # [m] its y


def test_passages_are_chains_of_cells_that_nobody_can_pass_in() -> None:
    """Two rooms, joined by an aisle with a blind one to the north and one to the south that bends to the west room."""
    passages = passages_of(floor_of(FLOOR))
    aisle, north, south = passages.numbers[5], passages.numbers[6:8, 9], passages.numbers[[4, 3, 2], 12]
    assert (aisle[[9, 12]] == -2).all()  # where others join
    assert (np.delete(aisle[1:-1], slice(6, 20)) == -1).all()
    parts = [aisle[7:9], aisle[10:12], aisle[13:21], north, np.append(south, passages.numbers[2, 7:12])]
    numbers = [set(part.tolist()) for part in parts]
    assert all(len(number) == 1 for number in numbers)
    assert {number.pop() for number in numbers} == set(range(5)) == set(range(len(passages.blind)))
    assert passages.blind.nonzero()[0].tolist() == [north[0]]
    assert (passages.numbers >= 0).sum() == sum(part.size for part in parts)
    ways = passages.along[passages.numbers == south[0]]
    round_the_bend = {tuple(np.sign(way).tolist()) for way in ways}
    assert round_the_bend in ({(-1, 0), (-1, -1), (0, -1)}, {(1, 0), (1, 1), (0, 1)})


def seen(own: tuple[float, ...], *others: tuple[tuple[float, float], tuple[float, float]], **fields: Any) -> Any:
    """The predictions [speed, lateral offset] of a robot that drives 16 m east, beside others on their ways."""
    options: dict[str, Any] = {"speed_levels": (-0.4, 0.0, 1.3), "sensor": SensorSpec(predictions=True)}
    poses = [(*begin, 0.0) for begin, _ in others]
    simulator = stage(FLOOR, own, *poses, action_type="discrete", **options)
    lay(simulator, (own[0] - 1, AISLE), (own[0] - 1 + 16, AISLE))
    write(simulator.robots[0, 0], position=1.0)
    for robot, ways in enumerate(others, 1):
        lay(simulator, *ways, robot=robot)
        write(simulator.robots[0, robot], **fields)
    simulator._observe()
    return predictions(simulator)


def predictions(simulator: Simulator) -> NDArray[np.float32]:
    """Of robot 0, [speed, lateral offset]."""
    values: NDArray[np.float32] = simulator.observation[0, 0, simulator.layout.slices["predictions"]].reshape(3, 5)
    return values


WEST = (19.5, AISLE), (13.5, AISLE)
EAST = WEST[::-1]


def test_a_robot_foresees_that_another_comes_along_the_aisle_before_it() -> None:
    """Front axle at x = 2.5, 1.3 m/s; the aisle begins at x = 6 and the other is 17 m away, beyond what is sensed."""
    got = seen((2.5, AISLE, 0.0, 1.3), WEST)
    assert (got[[BACK, STAND]] == 1).all()
    last = 6.0 - 1.4 - 2.5  # [m]; points of the route are looked at every half metre
    assert last / 1.3 - 0.2 <= 2.4 * got[FAST, 0] <= (last + 0.5) / 1.3


@pytest.mark.parametrize(
    ("own", "other", "fields"),
    [
        (3.0, EAST, {}),  # it drives the same way
        (3.0, ((22.0, 2.0), (22.0, 6.0)), {}),  # it is in the room behind
        (3.0, WEST, {"silent": 1}),  # nobody hears of it
        (3.0, WEST, {"alive": 0}),  # it is parked
        (15.0, ((18.5, AISLE), (21.0, AISLE)), {}),  # both are in it, and drive the same way
    ],
)
def test_nobody_else_bars_the_aisle(own: float, other: Any, fields: dict[str, Any]) -> None:
    assert (seen((own, AISLE, 0.0, 1.3 if own < 6 else 0.0), other, **fields)[[STAND, BACK]] == 1).all()
    assert (seen((own, AISLE, 0.0), other, **fields) == 1).all()


def test_it_waits_outside_for_all_aisles_in_a_row() -> None:
    """The other comes along the third aisle from here, where no place to pass is before."""
    other = (18.5, AISLE), (14.5, AISLE)
    assert seen((3.0, AISLE, 0.0, 1.3), other)[FAST, 0] < 1
    last = 12.0 - 1.4 - 8.4  # [m] from where one in the first aisle may still drive on, to the third
    assert last / 1.3 - 0.2 <= 2.4 * seen((8.4, AISLE, 0.0, 1.3), other)[FAST, 0] <= (last + 0.5) / 1.3


def test_a_robot_in_a_blind_aisle_is_predicted_to_come_out() -> None:
    simulator = stage(
        FLOOR, (3.0, AISLE, 0.0, 1.3), (8.5, 5.8, 1.5), action_type="discrete", sensor=SensorSpec(predictions=True)
    )
    lay(simulator, (2.0, AISLE), (8.5, AISLE), (8.5, 6.5))
    write(simulator.robots[0, 0], position=1.0)
    lay(simulator, (8.5, 5.5), (8.5, 6.5), robot=1)
    simulator._observe()
    assert simulator._scratch.step.sights.free_ways[0] == pytest.approx(6.0 - 1.4 - 3.0)
    lay(simulator, (2.0, AISLE), (10.0, AISLE))  # past it
    simulator._observe()
    assert simulator._scratch.step.sights.free_ways[0] == np.inf


def test_contact_is_worse_than_a_way_towards_another() -> None:
    """Beyond where it should wait, driving on counts as free for .8 s."""
    assert seen((5.5, AISLE, 0.0), WEST)[FAST, 0] == np.float32(4 / 12)
