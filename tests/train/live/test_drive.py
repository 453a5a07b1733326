"""Test a live world and its drive: pace, message order, figures, refusals; none of them changes the bits."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.train.live.worlds import bits, messages, world
from train.kinds import KindPart, Kinds
from train.live import drive
from train.live.drive import WorldDrive
from train.live.messages import WINDOW, Listener, Listeners, LiveFigures, Sample
from train.live.world import MOST_BYTES, Make, Play, Speed, Step, World, read_command
from warehouse_env.config import RobotSpec
from warehouse_env.errors import ConfigError, WarehouseError


class Clock:
    """Clock that moves only by assignment."""

    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(drive, "time", found)
    return found


def run_for(one: WorldDrive, clock: Clock, seconds: float) -> None:
    """Run everything due in a drive for `seconds`."""
    end = clock.now + seconds
    while (wait := one.due_in()) <= end - clock.now:
        clock.now += max(wait, 0.0)
        one.turn()
    clock.now = end


def test_drive_keeps_its_pace(clock: Clock) -> None:
    one = WorldDrive(world(), Listeners())
    run_for(one, clock, 2.05)
    assert one.world.steps == 21  # one step at once, then ten a second
    one.obey(Speed(4.0))
    run_for(one, clock, 1.02)
    assert one.world.steps == 21 + 41
    one.obey(Play(False))
    run_for(one, clock, 5.0)
    assert one.world.steps == 62
    one.obey(Step())
    run_for(one, clock, 5.0)
    assert one.world.steps == 63
    one.obey(Play(True))
    run_for(one, clock, 0.24)
    assert one.world.steps == 63 + 10


def test_drive_does_not_catch_up_missed_time(clock: Clock) -> None:
    one = WorldDrive(world(), Listeners())
    one.turn()
    clock.now += 60.0  # the machine slept
    before = one.world.steps
    run_for(one, clock, 1.0)
    assert one.world.steps - before <= 11 + 3


def test_pages_get_all_moments_in_order(clock: Clock) -> None:
    everybody = Listeners()
    one = WorldDrive(world(), everybody)
    with everybody.joined() as early:
        run_for(one, clock, 3.0)
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
    run_for(one, clock, 5.05)
    with everybody.joined() as late:
        one.turn()
        ((header, _), *_) = messages(late.take(0.0))
    assert [sample[0] for sample in header["samples"]] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert header["begin"] == one.world.seconds
    assert header["seconds"] == 0.1


def test_pages_are_notified_of_a_new_world(clock: Clock) -> None:
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


def test_pace_and_pages_do_not_change_the_bits(clock: Clock) -> None:
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


def driven(steps: int, **setting: object) -> World:
    """Return a world after `steps` steps."""
    one = world(**setting)
    for _ in range(steps):
        one.step()
    return one


def test_the_same_setting_gives_the_same_bits() -> None:
    one, again = driven(60), driven(5)
    again.make(Make(seed=7))
    for _ in range(60):
        again.step()
    assert bits(one) == bits(again)
    assert (one.steps, one.seconds, one.made, again.made) == (60, pytest.approx(6.0), 1, 2)
    assert bits(driven(60, seed=8)) != bits(one)


def test_any_setting_restarts_the_world() -> None:
    kinds = Kinds((KindPart(RobotSpec(length=1.2, width=1.2), share=1.0),))
    one = driven(5, chosen={"people": 1}, kinds=kinds)
    one.make(Make(policy="brake", robots=6))
    assert (one.steps, len(one.moment()["pose"]), len(one.moment()["people"])) == (0, 6, 1)
    assert [robot.width for robot in one.simulator.config.robots] == [1.2] * 6
    one.make(Make(floor="paper46", seed=3))
    assert (one.grid.name, one.setting.seed, one.setting.policy) == ("paper46", 3, "brake")


@pytest.mark.parametrize(
    ("setting", "why"),
    [
        (Make(policy="agents/weights/ppo"), "unknown policy"),
        (Make(floor="aisles:seed=7"), "unknown floor"),
        (Make(floor="/etc/passwd"), "unknown floor"),
        (Make(floor="open", robots=256), "num_agents=256"),
    ],
)
def test_impossible_settings_are_refused(setting: Make, why: str) -> None:
    one, same = driven(1), driven(2)
    with pytest.raises(WarehouseError, match=why):
        one.make(setting)
    one.step()
    assert (one.made, bits(one)) == (1, bits(same))


@pytest.mark.parametrize(
    ("message", "command"),
    [
        ({"do": "play", "playing": False}, Play(False)),
        ({"do": "speed", "speed": 4}, Speed(4.0)),
        ({"do": "speed", "speed": None}, Speed(None)),
        ({"do": "step"}, Step()),
        ({"do": "make", "robots": 12, "seed": 0}, Make(robots=12, seed=0)),
    ],
)
def test_messages_are_commands(message: dict[str, object], command: object) -> None:
    assert read_command(json.dumps(message).encode()) == command


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (b"", "must be a JSON object"),
        (b'{"do": "plai"}', "did you mean play"),
        (b'{"do": "play"}', "lacks the entry 'playing'"),
        (b'{"do": "play", "playing": true, "also": 1}', "unknown play parameter"),
        (b'{"do": "speed", "speed": 0.1}', "from 0.25 to 1000"),
        (b'{"do": "make", "map": "/etc/passwd"}', "unknown make parameter"),
        (b'{"do": "step"' + b" " * MOST_BYTES + b"}", "at most 65,536 bytes"),
    ],
)
def test_invalid_command_is_one_sentence(message: bytes, why: str) -> None:
    with pytest.raises(ConfigError) as refused:
        read_command(message)
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 300


def moment(goals: int, contacts: int = 0, waits: tuple[int, ...] = (-1, -1), speed: tuple[float, ...] = (1.0, 1.0)):  # type: ignore[no-untyped-def]
    return {
        "flags": np.ones(2, np.uint16), "waits_for": np.array(waits), "speed": np.array(speed, np.float32),
        "totals": np.array([goals, contacts, 0]),
    }  # fmt: skip


def test_samples_average_the_steps_of_a_second() -> None:
    figures = LiveFigures()
    assert figures.add(0.5, moment(0, waits=(1, -1), speed=(0.0, 1.0))) is None
    sample = figures.add(1.0, moment(1, contacts=3, speed=(0.0, 0.0)))
    assert sample == Sample(1.0, pytest.approx(1 / 2 / 1.0 * 3600), 0.25, 0.75, 3)
    assert figures.add(1.5, moment(1)) is None
    assert figures.add(2.0, moment(1)) == Sample(2.0, pytest.approx(900.0), 0.0, 0.0, 0)


def test_goals_per_hour_cover_the_last_two_minutes() -> None:
    figures = LiveFigures()
    for second in range(1, 301):
        figures.add(float(second), moment(goals=min(second, 100)))
    assert figures.samples[99].goals_per_robot_hour == pytest.approx(1800.0)
    assert figures.samples[159].goals_per_robot_hour == pytest.approx((100 - 40) / 2 / WINDOW * 3600)
    assert figures.samples[-1].goals_per_robot_hour == 0.0


def test_parked_robots_neither_wait_nor_stand() -> None:
    one = moment(0, waits=(1, -1), speed=(0.0, 0.0)) | {"flags": np.array([1, 0], np.uint16)}
    sample = LiveFigures().add(1.0, one)
    assert sample is not None
    assert (sample.waiting, sample.standing) == (1.0, 1.0)


def test_slow_page_restarts_with_a_whole_world(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("train.live.messages.MOST_WAITING", 2)
    listener = Listener()
    listener.put(b"lost")
    listener.put(b"world", world=True)
    listener.put(b"more")
    assert not listener.needs_world
    assert listener.take(0.0) == b"worldmore"
    for _ in range(3):
        listener.put(b"more")
    assert listener.needs_world
    assert listener.take(0.0) == b""
    listener.put(b"a whole world", world=True)
    assert listener.take(0.0) == b"a whole world"
