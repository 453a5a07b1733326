"""A world that is replaced while it runs: what is refused, and that it repeats."""

from __future__ import annotations

import pytest

from tests.train.live.worlds import world
from train.kinds import KindPart, Kinds
from train.live.commands import Make
from train.live.world import World
from warehouse_env.config import RobotSpec
from warehouse_env.errors import WarehouseError


def driven(steps: int, **setting: object) -> World:
    """Return a world after so many steps."""
    one = world(**setting)
    for _ in range(steps):
        one.step()
    return one


def test_the_same_setting_gives_the_same_bits() -> None:
    one, again = driven(60), driven(5)
    again.make(Make(seed=7))
    for _ in range(60):
        again.step()
    assert one.digest == again.digest
    assert (one.steps, one.seconds, one.made, again.made) == (60, pytest.approx(6.0), 1, 2)
    assert driven(60, seed=8).digest != one.digest


def test_any_setting_restarts_the_world() -> None:
    kinds = Kinds((KindPart(RobotSpec(length=1.2, width=1.2), share=1.0),))
    one = driven(5, chosen={"people": 1}, kinds=kinds)
    one.make(Make(policy="brake", robots=6))
    assert (one.steps, len(one.moment()["pose"]), len(one.moment()["people"])) == (0, 6, 1)
    assert [robot.width for robot in one.simulator.config.robots] == [1.2] * 6
    one.make(Make(floor="paper46", seed=3))
    assert (one.grid.name, one.setting.seed, one.setting.policy) == ("paper46", 3, "brake")


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (Make(policy="agents/weights/ppo"), "unknown policy"),
        (Make(floor="aisles:seed=7"), "unknown floor"),
        (Make(floor="/etc/passwd"), "unknown floor"),
        (Make(floor="open", robots=256), "num_agents=256"),
    ],
)
def test_impossible_settings_are_refused(asked: Make, why: str) -> None:
    one, same = driven(1), driven(2)
    with pytest.raises(WarehouseError, match=why):
        one.make(asked)
    one.step()
    assert (one.made, one.digest) == (1, same.digest)
