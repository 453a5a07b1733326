"""Brokers for tests: amqtt in a thread, and a scripted one; certificates."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from train.fleet.messages import Message

amqtt = pytest.importorskip("amqtt.broker")
ANONYMOUS = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}


def free_port() -> int:
    """Return a free port of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def until(done: Callable[[], bool]) -> None:
    """Wait until a condition holds."""
    for _ in range(1000):
        if done():
            return
        time.sleep(0.01)
    raise AssertionError("the condition never held")


class _Strict(amqtt.Broker):  # type: ignore[misc, name-defined]
    """Requires client certificates on listeners with an authority; amqtt itself makes them optional."""

    @staticmethod
    def _create_ssl_context(listener: Any) -> ssl.SSLContext:
        context = amqtt.Broker._create_ssl_context(listener)
        assert isinstance(context, ssl.SSLContext)
        context.verify_mode = ssl.CERT_REQUIRED if listener.get("cafile") else ssl.CERT_NONE
        return context


@contextlib.contextmanager
def running(listeners: dict[str, dict[str, Any]], plugins: dict[str, Any]) -> Iterator[Any]:
    """Run amqtt with these listeners and plugins in a thread, at free ports."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    async def begin() -> Any:
        places = {name: {"type": "tcp", "bind": "127.0.0.1:0", **options} for name, options in listeners.items()}
        made = _Strict({"listeners": places, "plugins": plugins})
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


class Scripted:
    """A broker that sends messages to each client in turn, and hangs up; after the last it is gone.

    granted: code of each subscription; greeting: what it answers to a client's first packet.
    """

    def __init__(self, *told: list[Message], granted: int = 1, greeting: bytes = b"\x20\x02\x00\x00") -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self._told, self._granted, self._greeting = told, granted, greeting
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        for messages in self._told:
            line = self._server.accept()[0]
            with line, line.makefile("rb") as stream:
                _packet(stream)  # CONNECT
                line.sendall(self._greeting)
                if self._greeting[:1] != b"\x20":
                    continue
                number = _packet(stream)[:2]  # SUBSCRIBE
                codes = bytes([self._granted]) * 6
                line.sendall(b"\x90" + bytes([2 + len(codes)]) + number + codes)
                line.sendall(b"".join(map(_publish, messages)))
        self._server.close()


def _packet(stream: Any) -> bytes:
    """Read an MQTT packet; return it without its header."""
    length = stream.read(2)[1]
    if length >= 128:
        length += (stream.read(1)[0] - 1) * 128
    content: bytes = stream.read(length)
    return content


def _publish(message: Message) -> bytes:
    """Return a PUBLISH packet of quality 0."""
    topic, payload = message.topic.encode(), message.text.encode()
    body = len(topic).to_bytes(2) + topic + payload
    return bytes([0x30 + message.retain, len(body) % 128 + 128, len(body) // 128]) + body


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
