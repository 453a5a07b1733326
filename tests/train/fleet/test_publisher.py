"""Test publishing a fleet over MQTT to a broker in this process, and errors of failed connections."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from tests.train.fleet.stories import NAMES, story
from train.fleet.messages import Message
from train.fleet.publisher import Broker, broker_of, publish
from train.fleet.vehicle import messages_of
from warehouse_env.errors import ConfigError, LostError, WarehouseError

amqtt = pytest.importorskip("amqtt.broker")


def free_port() -> int:
    """Return a free port of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


@contextlib.contextmanager
def running(anonymous: bool) -> Iterator[Any]:
    """Run amqtt in a thread at a free port; anonymous: admit clients without a user."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    async def begin() -> Any:
        plugins = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": anonymous}}
        made = amqtt.Broker({"listeners": {"default": {"type": "tcp", "bind": "127.0.0.1:0"}}, "plugins": plugins})
        await made.start()
        return made

    made = asyncio.run_coroutine_threadsafe(begin(), loop).result(10)
    yield made
    asyncio.run_coroutine_threadsafe(made.shutdown(), loop).result(10)
    loop.call_soon_threadsafe(loop.stop)
    thread.join(10)


def port_of(made: Any) -> int:
    """Return amqtt's port."""
    return int(made._servers["default"].instance.sockets[0].getsockname()[1])


def fake_broker(reply: bytes) -> int:
    """Answer one client's first packet and hang up; return the port."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        with server, server.accept()[0] as line:
            line.recv(4096)
            line.sendall(reply)

    threading.Thread(target=serve, daemon=True).start()
    return int(server.getsockname()[1])


@contextlib.contextmanager
def subscription(broker: Broker, interface: str) -> Iterator[list[Any]]:
    """Subscribe to all vehicles of an interface; yield the messages up to the first OFFLINE."""
    heard: list[Any] = []
    ready = threading.Event()

    async def listen() -> None:
        async with broker.client() as client:
            await client.subscribe(f"{interface}/#", 1)
            ready.set()
            async for message in client.messages:
                if not message.retain:  # from an earlier test
                    heard.append(message)
                    if b"OFFLINE" in message.payload:
                        return

    thread = threading.Thread(target=lambda: asyncio.run(asyncio.wait_for(listen(), 20)), daemon=True)
    thread.start()
    assert ready.wait(10)
    yield heard
    thread.join(20)


FAST = 40.0


@pytest.fixture(scope="module")
def brokers() -> Iterator[Any]:
    """Run amqtt for clients without a user."""
    with running(anonymous=True) as made:
        yield made


def sent_contents(messages: list[Message]) -> list[tuple[str, Any]]:
    return [(message.topic, message.payload) for message in messages]


def received_contents(heard: list[Any]) -> list[tuple[str, Any]]:
    return [(str(message.topic), json.loads(message.payload)) for message in heard]


def test_published_messages_are_received(brokers: Any) -> None:
    broker, messages = Broker("127.0.0.1", port_of(brokers)), list(messages_of(story(), NAMES))
    with subscription(broker, NAMES.interface) as heard:
        assert publish(broker, messages, NAMES, ["00000"], FAST).messages == len(messages)
    assert received_contents(heard) == sent_contents(messages)


def test_stopped_publisher_sends_offline(brokers: Any) -> None:
    def stopped() -> Iterator[Message]:
        yield from [message for message in messages_of(story(), NAMES) if message.seconds < 2]
        raise KeyboardInterrupt

    broker = Broker("127.0.0.1", port_of(brokers))
    with subscription(broker, NAMES.interface) as heard, pytest.raises(KeyboardInterrupt):
        publish(broker, stopped(), NAMES, ["00000"], FAST)
    topic, payload = received_contents(heard)[-1]
    assert (topic[-10:], payload["connectionState"]) == ("connection", "OFFLINE")


def test_lost_broker_is_an_error() -> None:
    where = Broker("127.0.0.1", fake_broker(b"\x20\x02\x00\x00"), timeout=1.0)
    with pytest.raises(LostError, match=r"no longer answers .*messages were sent"):
        publish(where, messages_of(story(), NAMES), NAMES, ["00000"], 1.0)


def test_failed_connections_state_the_cause() -> None:
    bridge = "publish to a local broker that bridges to it"
    with socket.create_server(("127.0.0.1", 0)) as mute, running(anonymous=False) as guarded:
        for port, message in (
            (free_port(), "cannot be reached: "),
            (mute.getsockname()[1], f"does not answer: check host and port; if the port needs TLS, {bridge}"),
            (port_of(guarded), f"refuses clients without a password; {bridge}"),
        ):
            with pytest.raises(WarehouseError, match=rf"broker localhost:{port} {message}"):
                publish(Broker("localhost", port, timeout=0.3), messages_of(story(), NAMES), NAMES, ["00000"], 1.0)


def test_broker_is_named_by_host_and_port() -> None:
    assert broker_of("plant")[:2] == ("plant", 1883)
    assert broker_of("10.0.0.1:99")[:2] == ("10.0.0.1", 99)
    assert broker_of("[::1]:1884")[:2] == ("::1", 1884)
    for wrong in ("", ":1", "a:b", "a:70000", "mqtt://a", "a" * 300, "::1"):
        with pytest.raises(ConfigError, match="name it as HOST"):
            broker_of(wrong)
