"""A fleet over MQTT, with a broker in this process on loopback; brokers that are gone, slow, or not what was said."""

from __future__ import annotations

import asyncio
import json
import re
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.train.fleet.brokers import ANONYMOUS, Scripted, free_port, port_of, running, until
from tests.train.fleet.stories import NAMES, lines, story
from train.cli import LOST, main
from train.fleet import subscriber
from train.fleet.broker import Broker, broker_of
from train.fleet.build import episode_of
from train.fleet.check import check_log
from train.fleet.listen import Heard, hear_broker
from train.fleet.messages import Message
from train.fleet.publisher import publish
from train.fleet.secure import secure_context
from train.fleet.write import messages_of, write_floor
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WarehouseError

FAST = 40.0


@pytest.fixture(scope="module")
def running_broker() -> Iterator[tuple[Broker, Any]]:
    """amqtt, and where it is."""
    with running({"default": {}}, ANONYMOUS) as made:
        yield Broker("127.0.0.1", port_of(made)), made


@pytest.fixture
def broker(running_broker: tuple[Broker, Any]) -> Broker:
    return running_broker[0]


def hearing(pool: ThreadPoolExecutor, running: tuple[Broker, Any], folder: Path, **more: Any) -> Any:
    """Listen in another thread; return what is to be asked for the result, once it listens."""
    options: dict[str, Any] = {"patience": 3.0, "seconds": None, **more}
    broker, made = running
    before = listeners(made)
    future = pool.submit(hear_broker, broker, NAMES.interface, folder, **options)
    until(lambda: bool(listeners(made) - before))
    return future


def listeners(made: Any) -> set[str]:
    """Return who listens at amqtt, by the last of the topics that are asked for."""
    return {session.client_id for session, _ in made._subscriptions.get("uagv/+/+/instantActions", ())}


def told(messages: list[Message]) -> list[tuple[str, Any]]:
    return [(message.topic, message.payload) for message in messages]


def test_what_is_published_is_heard(running_broker: tuple[Broker, Any], broker: Broker, tmp_path: Path) -> None:
    messages = list(messages_of(story(), NAMES))
    with ThreadPoolExecutor() as pool:
        future = hearing(pool, running_broker, tmp_path / "a")
        assert publish(broker, messages, NAMES, ["00000"], FAST).messages == len(messages)
        heard: Heard = future.result(10)
    assert (heard.why, heard.stopped) == ("all vehicles are offline", None)
    entries = lines(tmp_path / "a" / "messages.jsonl")
    assert [(entry["topic"], entry["payload"]) for entry in entries] == told(messages)
    assert check_log(tmp_path / "a").total == 0
    with ThreadPoolExecutor() as pool:  # the last word is kept, and is no vehicle that speaks
        late = hearing(pool, running_broker, tmp_path / "b", patience=0.5)
        with pytest.raises(WarehouseError, match=r"no vehicle said anything at 127.0.0.1:\d+ .*nothing came for 0.5 s"):
            late.result(10)
    assert not (tmp_path / "b" / "messages.jsonl").exists()


def test_whatever_ends_it_vehicles_go_offline(
    running_broker: tuple[Broker, Any], broker: Broker, tmp_path: Path
) -> None:
    def stopped() -> Iterator[Message]:
        yield from [message for message in messages_of(story(), NAMES) if message.seconds < 2]
        raise KeyboardInterrupt

    with ThreadPoolExecutor() as pool:
        future = hearing(pool, running_broker, tmp_path)
        with pytest.raises(KeyboardInterrupt):
            publish(broker, stopped(), NAMES, ["00000"], FAST)
        future.result(10)
    last = lines(tmp_path / "messages.jsonl")[-1]
    assert (last["topic"][-10:], last["payload"]["connectionState"], last["payload"]["headerId"]) == (
        "connection", "OFFLINE", 1)  # fmt: skip
    assert check_log(tmp_path).total == 0


def test_what_is_no_message_is_left_out_and_what_came_is_kept(
    running_broker: tuple[Broker, Any], broker: Broker, tmp_path: Path
) -> None:
    async def shout() -> None:
        async with broker.client() as client:
            for payload in (b"\xff\x00", b"[" * 5000, b"7", b"{}", json.dumps(states[0].payload).encode()):
                await client.publish("uagv/v2/ACME/00000/state", payload)

    states = [message for message in messages_of(story(), NAMES) if message.topic.endswith("state")]
    with ThreadPoolExecutor() as pool:
        future = hearing(pool, running_broker, tmp_path, seconds=1.5)
        asyncio.run(shout())
        heard: Heard = future.result(10)
        with pytest.raises(ConfigError, match="holds messages already"):
            hear_broker(broker, "uagv", tmp_path, 1.0, 1.0)
    assert heard.why == "1.5 s are over"
    assert (heard.fleet.messages, heard.fleet.left_out["are no message"], heard.fleet.places) == (2, 3, 1)


def test_a_broker_that_is_gone_or_slow_is_named(tmp_path: Path) -> None:
    messages = messages_of(story(), NAMES)
    gone = Broker("127.0.0.1", free_port())
    for call in (
        lambda where: publish(where, messages, NAMES, ["00000"], 1.0),
        lambda where: hear_broker(where, "uagv", tmp_path / "x", 1.0, None),
    ):
        with pytest.raises(WarehouseError, match=f"broker 127.0.0.1:{gone.port} cannot be reached"):
            call(gone)
        with socket.create_server(("127.0.0.1", 0)) as mute:  # takes connections and never says a word
            slow = Broker("127.0.0.1", mute.getsockname()[1], timeout=0.3)
            with pytest.raises(WarehouseError, match=r"cannot be reached: .*timed out"):
                call(slow)
    assert not (tmp_path / "x" / "messages.jsonl").exists()


def test_a_connection_that_breaks_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subscriber, "AGAIN", 0.05)
    messages = list(messages_of(story(), NAMES))
    again = messages[0]  # which the broker has kept, and says once more
    scripted = Scripted(messages[:9], [], [again, *messages[12:]])
    heard = hear_broker(Broker("127.0.0.1", scripted.port), "uagv", tmp_path, 5.0, None)
    assert (heard.why, heard.stopped) == ("all vehicles are offline", None)
    assert told(messages[:9] + messages[12:]) == [
        (entry["topic"], entry["payload"]) for entry in lines(tmp_path / "messages.jsonl") if entry["payload"] != again
    ]
    assert len(heard.fleet.gaps) == 1
    made = episode_of(heard.fleet, story().replay.grid, EnvConfig())
    assert any(re.match(r"the connection to the broker broke 1 time; nothing was heard for", n) for n in made.notes)


def test_a_broker_that_does_not_come_back_is_an_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(subscriber, "AGAIN", 0.05)
    write_floor(story(), tmp_path)
    command = ["fleet", "--map", str(tmp_path / "floor.yaml"), "--patience", "0.2", "--listen"]
    for number, messages in enumerate((list(messages_of(story(), NAMES))[:20], [])):
        folder = tmp_path / str(number)
        scripted = Scripted(messages)
        assert main([*command, f"127.0.0.1:{scripted.port}", "--out", str(folder)]) == LOST
        out, error = capsys.readouterr()
        assert re.search(r"warehouse: broker 127.0.0.1:\d+ went away .* and did not come back", error)
        assert "Traceback" not in out + error
        assert (folder / "episode.npz").exists() == (folder / "messages.jsonl").exists() == bool(messages)
        assert (f"what came is kept in {folder}" in error) == bool(messages)
        assert ("the broker is gone: 20 messages" in out) == bool(messages)


def test_who_may_not_listen_is_told(tmp_path: Path) -> None:
    scripted = Scripted([], granted=0x80)
    with pytest.raises(WarehouseError, match="does not let user 'guest' read below uagv/; have it allowed"):
        hear_broker(Broker("127.0.0.1", scripted.port, "guest"), "uagv", tmp_path, 1.0, None)


def test_brokers_are_named_as_hosts_with_ports() -> None:
    assert broker_of("plant")[:2] == ("plant", 1883)
    assert broker_of("10.0.0.1:99")[:2] == ("10.0.0.1", 99)
    assert broker_of("[::1]:1884")[:2] == ("::1", 1884)
    assert broker_of("plant", context=secure_context(None, None, None)).port == 8883
    for wrong in ("", ":1", "a:b", "a:0", "a:70000", "a b", "mqtt://a", "a" * 300, "::1"):
        with pytest.raises(ConfigError, match="name it as HOST"):
            broker_of(wrong)
