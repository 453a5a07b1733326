"""Brokers for tests: amqtt in a thread, one that answers a single packet, a subscriber; certificates."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import socket
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from train.fleet.publisher import Broker

amqtt = pytest.importorskip("amqtt.broker")
ANONYMOUS = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}


def free_port() -> int:
    """Return a free port of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


@contextlib.contextmanager
def running(listeners: dict[str, dict[str, Any]], plugins: dict[str, Any]) -> Iterator[Any]:
    """Run amqtt with these listeners and plugins in a thread, at free ports."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    async def begin() -> Any:
        places = {name: {"type": "tcp", "bind": "127.0.0.1:0", **options} for name, options in listeners.items()}
        made = amqtt.Broker({"listeners": places, "plugins": plugins})
        await made.start()
        return made

    made = asyncio.run_coroutine_threadsafe(begin(), loop).result(10)
    yield made
    asyncio.run_coroutine_threadsafe(made.shutdown(), loop).result(10)
    loop.call_soon_threadsafe(loop.stop)
    thread.join(10)


def port_of(made: Any, name: str = "default") -> int:
    """Return the port of a listener of amqtt."""
    return int(made._servers[name].instance.sockets[0].getsockname()[1])


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


class Authority:
    """A certificate authority for tests, made by openssl; its files are NAME.pem and NAME.key in a folder."""

    def __init__(self, folder: Path, name: str) -> None:
        if shutil.which("openssl") is None:
            pytest.skip("openssl is not installed")
        self._folder, self._name = folder, name
        self._openssl("req", "-x509", *self._key(name), "-subj", f"/CN={name}", "-out", f"{name}.pem")

    def sign(self, name: str, hosts: str, days: int = 2) -> None:
        """Make a certificate and its key; hosts: as in "DNS:plant,IP:127.0.0.1"."""
        (self._folder / "hosts.txt").write_text(f"subjectAltName={hosts}\n")
        self._openssl("req", "-new", *self._key(name), "-subj", f"/CN={name}", "-out", "asked.csr")
        self._openssl(
            "x509", "-req", "-in", "asked.csr", "-CA", f"{self._name}.pem", "-CAkey", f"{self._name}.key",
            "-CAcreateserial", "-days", str(days), "-extfile", "hosts.txt", "-out", f"{name}.pem",
        )  # fmt: skip

    def _key(self, name: str) -> list[str]:
        return ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", f"{name}.key"]

    def _openssl(self, *words: str) -> None:
        subprocess.run(["openssl", *words], cwd=self._folder, check=True, capture_output=True)
