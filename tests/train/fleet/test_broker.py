"""A fleet over MQTT, with a broker in this process on loopback; brokers that are gone, slow, or not what was said."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.train.fleet.stories import NAMES, lines, story
from train.fleet import broker as mqtt
from train.fleet.broker import Broker, broker_of, publish
from train.fleet.check import check_log
from train.fleet.listen import Heard, hear_broker
from train.fleet.messages import Message
from train.fleet.write import messages_of
from warehouse_env.errors import ConfigError, WarehouseError

amqtt = pytest.importorskip("amqtt.broker")
FAST = 40.0
_ANONYMOUS = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


@pytest.fixture(scope="module")
def broker() -> Iterator[Broker]:
    """amqtt in a thread of its own; which plugins it has it wants to be told."""
    port, loop = free_port(), asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    async def begin() -> Any:
        listener = {"type": "tcp", "bind": f"127.0.0.1:{port}"}
        made = amqtt.Broker({"listeners": {"default": listener}, "plugins": _ANONYMOUS})
        await made.start()
        return made

    made = asyncio.run_coroutine_threadsafe(begin(), loop).result(10)
    yield Broker("127.0.0.1", port)
    asyncio.run_coroutine_threadsafe(made.shutdown(), loop).result(10)
    loop.call_soon_threadsafe(loop.stop)
    thread.join(10)


def hearing(pool: ThreadPoolExecutor, broker: Broker, folder: Path, **more: Any) -> Any:
    """Listen in another thread; return what is to be asked for the result, once it listens."""
    options: dict[str, Any] = {"patience": 3.0, "seconds": None, **more}
    future = pool.submit(hear_broker, broker, NAMES.interface, folder, **options)
    until = time.monotonic() + 5
    while not (folder / "messages.jsonl").exists() and time.monotonic() < until:
        time.sleep(0.02)
    time.sleep(0.3)  # to subscribe
    return future


def told(messages: list[Message]) -> list[tuple[str, Any]]:
    return [(message.topic, message.payload) for message in messages]


def test_what_is_published_is_heard(broker: Broker, tmp_path: Path) -> None:
    messages = list(messages_of(story(), NAMES))
    with ThreadPoolExecutor() as pool:
        future = hearing(pool, broker, tmp_path / "a")
        assert publish(broker, messages, NAMES, ["00000"], FAST).messages == len(messages)
        heard: Heard = future.result(10)
    assert (heard.why, heard.stopped) == ("all vehicles are offline", None)
    entries = lines(tmp_path / "a" / "messages.jsonl")
    assert [(entry["topic"], entry["payload"]) for entry in entries] == told(messages)
    assert check_log(tmp_path / "a").total == 0
    with ThreadPoolExecutor() as pool:  # the last word is kept, and is no vehicle that speaks
        late = hearing(pool, broker, tmp_path / "b", patience=0.5)
        with pytest.raises(WarehouseError, match=r"no vehicle said anything at 127.0.0.1:\d+ .*nothing came for 0.5 s"):
            late.result(10)
    assert not (tmp_path / "b" / "messages.jsonl").exists()


def test_whatever_ends_it_vehicles_go_offline(broker: Broker, tmp_path: Path) -> None:
    def stopped() -> Iterator[Message]:
        yield from [message for message in messages_of(story(), NAMES) if message.seconds < 2]
        raise KeyboardInterrupt

    with ThreadPoolExecutor() as pool:
        future = hearing(pool, broker, tmp_path)
        with pytest.raises(KeyboardInterrupt):
            publish(broker, stopped(), NAMES, ["00000"], FAST)
        future.result(10)
    last = lines(tmp_path / "messages.jsonl")[-1]
    assert (last["topic"][-10:], last["payload"]["connectionState"], last["payload"]["headerId"]) == (
        "connection", "OFFLINE", 1)  # fmt: skip
    assert check_log(tmp_path).total == 0


def test_what_is_no_message_is_left_out_and_what_came_is_kept(broker: Broker, tmp_path: Path) -> None:
    async def shout() -> None:
        async with broker.client() as client:
            for payload in (b"\xff\x00", b"[" * 5000, b"7", b"{}", json.dumps(states[0].payload).encode()):
                await client.publish("uagv/v2/ACME/00000/state", payload)

    states = [message for message in messages_of(story(), NAMES) if message.topic.endswith("state")]
    with ThreadPoolExecutor() as pool:
        future = hearing(pool, broker, tmp_path, seconds=1.5)
        asyncio.run(shout())
        heard: Heard = future.result(10)
        with pytest.raises(ConfigError, match="holds messages already"):
            hear_broker(broker, "uagv", tmp_path, 1.0, 1.0)
    assert heard.why == "1.5 s are over"
    assert (heard.fleet.messages, heard.fleet.left_out["are no message"], heard.fleet.places) == (2, 3, 1)


def test_a_broker_that_is_gone_or_slow_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mqtt, "TIMEOUT", 0.3)
    messages = messages_of(story(), NAMES)
    gone = Broker("127.0.0.1", free_port())
    for call in (
        lambda where: publish(where, messages, NAMES, ["00000"], 1.0),
        lambda where: hear_broker(where, "uagv", tmp_path / "x", 1.0, None),
    ):
        with pytest.raises(WarehouseError, match=f"broker 127.0.0.1:{gone.port} cannot be reached"):
            call(gone)
        with socket.create_server(("127.0.0.1", 0)) as mute:  # takes connections and never says a word
            slow = Broker("127.0.0.1", mute.getsockname()[1])
            with pytest.raises(WarehouseError, match=r"cannot be reached: .*timed out"):
                call(slow)
    assert not (tmp_path / "x" / "messages.jsonl").exists()


def test_brokers_are_named_as_hosts_with_ports() -> None:
    assert broker_of("plant")[:2] == ("plant", 1883)
    assert broker_of("10.0.0.1:99")[:2] == ("10.0.0.1", 99)
    assert broker_of("[::1]:1884")[:2] == ("::1", 1884)
    assert broker_of("plant", secure=True).port == 8883
    for wrong in ("", ":1", "a:b", "a:0", "a:70000", "a b", "mqtt://a", "a" * 300, "::1"):
        with pytest.raises(ConfigError, match="name it as HOST"):
            broker_of(wrong)
