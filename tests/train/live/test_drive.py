"""A world in time: the pace, what pages are told and in which order, and that neither touches the bits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.train.live.worlds import messages, world
from train.live import drive
from train.live.commands import Make, Play, Shelves, Speed, Step
from train.live.drive import Drive
from train.live.listeners import Listeners
from warehouse_env.errors import WarehouseError


class Clock:
    """Time that goes on only when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(drive, "time", found)
    return found


def go(one: Drive, clock: Clock, seconds: float) -> None:
    """Let a drive do what is due, for so long."""
    end = clock.now + seconds
    while (wait := one.due_in()) <= end - clock.now:
        clock.now += max(wait, 0.0)
        one.turn()
    clock.now = end


def column(header: dict[str, Any], data: bytes, name: str) -> np.ndarray:
    """Return one column [N, F] of a message, worked out from what its header says of all."""
    at = 0
    for one in header["columns"]:
        count = int(np.prod(one["shape"]))
        planes = np.frombuffer(data[at : at + count * one["width"]], np.uint8).reshape(one["width"], count)
        at += planes.size
        if one["name"] == name:
            bits = 8 * one["width"]
            values = sum(plane.astype(np.int64) << 8 * k for k, plane in enumerate(planes)).reshape(one["shape"])
            for _ in range(one["order"]):
                values = np.cumsum(values, axis=-1)
            values = values % 2**bits
            return np.where(one["signed"] & (values >= 2 ** (bits - 1)), values - 2**bits, values) * one["unit"]
    raise AssertionError(f"no column {name}")


def test_the_pace_is_kept(clock: Clock) -> None:
    one = Drive(world(), Listeners())
    go(one, clock, 2.05)
    assert one.world.steps == 21  # one at once, then ten a second
    one.obey(Speed(4.0))
    go(one, clock, 1.02)
    assert one.world.steps == 21 + 41
    one.obey(Play(False))
    go(one, clock, 5.0)
    assert one.world.steps == 62
    one.obey(Step())
    go(one, clock, 5.0)
    assert one.world.steps == 63
    one.obey(Play(True))
    go(one, clock, 0.24)
    assert one.world.steps == 63 + 10


def test_a_pace_that_cannot_be_kept_is_let_go(clock: Clock) -> None:
    one = Drive(world(), Listeners())
    one.turn()
    clock.now += 60.0  # the machine slept
    before = one.world.steps
    go(one, clock, 1.0)
    assert one.world.steps - before <= 11 + 3


def test_pages_are_told_all_in_order(clock: Clock) -> None:
    everybody = Listeners()
    one = Drive(world(), everybody)
    poses: dict[int, np.ndarray] = {}
    with everybody.joined() as early:
        go(one, clock, 3.0)
        with everybody.joined() as late:
            for _ in range(260):
                one.obey(Step())
                one.turn()
            told = [list(messages(listener.take(0.0))) for listener in (early, late)]
    for said in told:
        assert said[0][0]["kind"] == "world"
        known, following, seconds = set(said[0][0]["routes"]), said[0][0]["first"] + 1, 0.0
        for header, data in said:
            if header["kind"] == "moments":
                assert header["first"] == following
                following += header["count"]
            if header["kind"] != "note":
                known |= set(header["routes"])
                assert set(column(header, data, "route").ravel().astype(int)) <= known
                assert column(header, data, "x").shape == (4, header["count"])
                for sample in header["samples"]:
                    assert sample[0] >= seconds
                    seconds = sample[0]
    # what both were told of one moment is the same
    for said in told:
        for header, data in said:
            for k in range(header.get("count", 0)):
                xy = np.stack([column(header, data, axis)[:, k] for axis in "xy"])
                np.testing.assert_allclose(poses.setdefault(header["first"] + k, xy), xy, atol=1e-9)
    last = poses[max(poses)]
    np.testing.assert_allclose(last, one.world.simulator.state.pose[0, :, :2].T, atol=0.0011)


def test_who_comes_late_has_the_samples_before(clock: Clock) -> None:
    everybody = Listeners()
    one = Drive(world(), everybody)
    go(one, clock, 5.05)
    with everybody.joined() as late:
        one.turn()
        ((header, _), *_) = messages(late.take(0.0))
    assert [sample[0] for sample in header["samples"]] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert header["begin"] == one.world.seconds
    assert header["seconds"] == 0.1


def test_pages_hear_that_a_world_is_made_and_of_which(clock: Clock) -> None:
    everybody = Listeners()
    one = Drive(world(), everybody)
    with everybody.joined() as page:
        one.turn()
        page.take(0.0)
        one.obey(Make(robots=5))
        one.turn()
        kinds = [header for header, _ in messages(page.take(0.0))]
        assert [header["kind"] for header in kinds] == ["world", "note"]
        assert kinds[0]["robots"] == 5
        assert kinds[0]["samples"] == []
        with pytest.raises(WarehouseError, match="no cell"):
            one.obey(Shelves(((-1, -1),), True))
        making = [header["making"] for header, _ in messages(page.take(0.0)) if header["kind"] == "note"]
        assert making == [drive.MAKING, None]


def test_neither_pace_nor_pages_touch_the_bits(clock: Clock) -> None:
    plain = world()
    for _ in range(60):
        plain.step()
    everybody = Listeners()
    one = Drive(world(), everybody)
    one.obey(Speed(None))
    with everybody.joined():
        while one.world.steps < 60:
            one.turn()
            clock.now += 0.01
    assert one.world.digest == plain.digest


def test_where_robots_stop_pages_are_told_the_poses_of_their_goals(clock: Clock) -> None:
    everybody = Listeners()
    one = Drive(world(chosen={"arrival": "pose"}), everybody)
    with everybody.joined() as listener:
        go(one, clock, 0.5)
        said = [heard for heard in messages(listener.take(0.0)) if heard[0]["kind"] != "note"]
    goals = one.world.simulator.robots[0]
    for name in ("goal_x", "goal_y"):
        np.testing.assert_allclose(column(*said[-1], name)[:, -1], goals[name], atol=0.005)
    assert column(*said[-1], "goal_heading").shape == (4, said[-1][0]["count"])
