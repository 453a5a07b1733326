"""A driven world: its pace, the messages to pages and their order, and that neither changes the bits."""

from __future__ import annotations

import pytest

from tests.train.live.worlds import bits, messages, world
from train.live import drive
from train.live.commands import Make, Play, Speed, Step
from train.live.drive import WorldDrive
from train.live.listeners import Listeners
from warehouse_env.errors import WarehouseError


class Clock:
    """Time that stands still unless it is moved."""

    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(drive, "time", found)
    return found


def go(one: WorldDrive, clock: Clock, seconds: float) -> None:
    """Let a drive do what is due, for this time."""
    end = clock.now + seconds
    while (wait := one.due_in()) <= end - clock.now:
        clock.now += max(wait, 0.0)
        one.turn()
    clock.now = end


def test_the_pace_is_kept(clock: Clock) -> None:
    one = WorldDrive(world(), Listeners())
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


def test_a_pace_that_cannot_be_kept_starts_anew(clock: Clock) -> None:
    one = WorldDrive(world(), Listeners())
    one.turn()
    clock.now += 60.0  # the machine slept
    before = one.world.steps
    go(one, clock, 1.0)
    assert one.world.steps - before <= 11 + 3


def test_pages_get_all_moments_in_order(clock: Clock) -> None:
    everybody = Listeners()
    one = WorldDrive(world(), everybody)
    with everybody.joined() as early:
        go(one, clock, 3.0)
        with everybody.joined() as late:
            for _ in range(260):
                one.obey(Step())
                one.turn()
            sent = [[header for header, _ in messages(listener.take(0.0))] for listener in (early, late)]
    for headers in sent:
        assert headers[0]["kind"] == "world"
        known, following, seconds = set(headers[0]["routes"]), headers[0]["first"] + 1, 0.0
        for header in headers[1:]:
            if header["kind"] == "moments":
                assert header["first"] == following
                following += header["count"]
                known |= set(header["routes"])
                for sample in header["samples"]:
                    assert sample[0] >= seconds
                    seconds = sample[0]
        assert set(one._lines.current()) <= known  # the routes of all robots were sent


def test_a_late_page_gets_earlier_samples(clock: Clock) -> None:
    everybody = Listeners()
    one = WorldDrive(world(), everybody)
    go(one, clock, 5.05)
    with everybody.joined() as late:
        one.turn()
        ((header, _), *_) = messages(late.take(0.0))
    assert [sample[0] for sample in header["samples"]] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert header["begin"] == one.world.seconds
    assert header["seconds"] == 0.1


def test_pages_hear_that_a_world_is_made(clock: Clock) -> None:
    everybody = Listeners()
    one = WorldDrive(world(), everybody)
    with everybody.joined() as page:
        one.turn()
        page.take(0.0)
        one.obey(Make(robots=5))
        one.turn()
        kinds = [header for header, _ in messages(page.take(0.0))]
        assert [header["kind"] for header in kinds] == ["world", "note"]
        assert kinds[0]["robots"] == 5
        assert kinds[0]["samples"] == []
        with pytest.raises(WarehouseError, match="unknown floor"):
            one.obey(Make(floor="none"))
        making = [header["making"] for header, _ in messages(page.take(0.0)) if header["kind"] == "note"]
        assert making == [drive.MAKING, None]


def test_neither_pace_nor_pages_touch_the_bits(clock: Clock) -> None:
    plain = world()
    for _ in range(60):
        plain.step()
    everybody = Listeners()
    one = WorldDrive(world(), everybody)
    one.obey(Speed(None))
    with everybody.joined():
        while one.world.steps < 60:
            one.turn()
            clock.now += 0.01
    assert bits(one.world) == bits(plain)
