"""Brokers for tests: amqtt in a thread, and one that says word for word what a test tells it to; certificates."""

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
    """Return a port of this machine that nobody listens at."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def until(done: Callable[[], bool]) -> None:
    """Wait until something is so."""
    for _ in range(1000):
        if done():
            return
        time.sleep(0.01)
    raise AssertionError("it never came to be so")


class _Strict(amqtt.Broker):  # type: ignore[misc, name-defined]
    """Asks for clients' certificates where a listener knows an authority; amqtt itself only takes them."""

    @staticmethod
    def _create_ssl_context(listener: Any) -> ssl.SSLContext:
        context = amqtt.Broker._create_ssl_context(listener)
        assert isinstance(context, ssl.SSLContext)
        context.verify_mode = ssl.CERT_REQUIRED if listener.get("cafile") else ssl.CERT_NONE
        return context


@contextlib.contextmanager
def running(listeners: dict[str, dict[str, Any]], plugins: dict[str, Any]) -> Iterator[Any]:
    """Have amqtt listen in a thread of its own, at free ports; which plugins it has it wants to be told."""
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
    """Return at which port a listener of amqtt is."""
    return int(made._servers[name].instance.sockets[0].getsockname()[1])


class Scripted:
    """A broker that lets one in who only greets, and then each in turn who listens, tells them messages, and hangs up.

    After the last nobody answers at its port any more.
    """

    def __init__(self, *told: list[Message], granted: int = 1) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self._told, self._granted = told, granted
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        for messages in (None, *self._told):
            line = self._server.accept()[0]
            with line, line.makefile("rb") as stream:
                _packet(stream)  # CONNECT
                line.sendall(b"\x20\x02\x00\x00")
                asked = _packet(stream)  # DISCONNECT of who only greets, or SUBSCRIBE: its number comes first
                if messages is not None:
                    codes = bytes([self._granted]) * 12
                    line.sendall(b"\x90" + bytes([2 + len(codes)]) + asked[:2] + codes)
                    line.sendall(b"".join(map(_publish, messages)))
        self._server.close()


def _packet(stream: Any) -> bytes:
    """Read a packet of MQTT; return what stands behind its header."""
    length = stream.read(2)[1]
    if length >= 128:
        length += (stream.read(1)[0] - 1) * 128
    content: bytes = stream.read(length)
    return content


def _publish(message: Message) -> bytes:
    """Return PUBLISH, at most once."""
    topic, payload = message.topic.encode(), message.text.encode()
    body = len(topic).to_bytes(2) + topic + payload
    return bytes([0x30 + message.retain, len(body) % 128 + 128, len(body) // 128]) + body


class Authority:
    """A certificate authority of a test, made by the program openssl; files lie in a folder as NAME.pem, NAME.key."""

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
