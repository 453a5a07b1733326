"""Brokers for tests: amqtt in a thread, one that answers a single packet, a subscriber."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from train.fleet.publisher import Broker

amqtt = pytest.importorskip("amqtt.broker")


def free_port() -> int:
    """Return a free port of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


@contextlib.contextmanager
def running(anonymous: bool) -> Iterator[Any]:
    """Run amqtt in a thread, at a free port; anonymous: it admits clients without a user."""
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


def answering(reply: bytes) -> int:
    """Answer one client's first packet and hang up; return the port."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        with server, server.accept()[0] as line:
            line.recv(4096)
            line.sendall(reply)

    threading.Thread(target=serve, daemon=True).start()
    return int(server.getsockname()[1])


@contextlib.contextmanager
def hearing(broker: Broker, interface: str) -> Iterator[list[Any]]:
    """Subscribe to all vehicles of an interface; yield what it hears up to the first OFFLINE, complete at the end."""
    heard: list[Any] = []
    ready = threading.Event()

    async def listen() -> None:
        async with broker.client() as client:
            await client.subscribe(f"{interface}/#", 1)
            ready.set()
            async for message in client.messages:
                if not message.retain:  # by an earlier test
                    heard.append(message)
                    if b"OFFLINE" in message.payload:
                        return

    thread = threading.Thread(target=lambda: asyncio.run(asyncio.wait_for(listen(), 20)), daemon=True)
    thread.start()
    assert ready.wait(10)
    yield heard
    thread.join(20)
