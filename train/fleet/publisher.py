"""Publish a fleet's messages to an MQTT broker when they are due, each vehicle over its own connection.

Needs the package aiomqtt.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import os
import re
import ssl
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from train.fleet.messages import Message, Names, Sender
from warehouse_env.errors import ConfigError, LostError, WarehouseError, shown
from warehouse_env.files import path_of, read_bytes

PORT, SECURE_PORT = 1883, 8883
PASSWORD = "WAREHOUSE_MQTT_PASSWORD"
"""Name of the environment variable that holds the password."""
TIMEOUT = 10.0  # [s] to wait for an answer of the broker
KEEP_ALIVE = 15  # [s] without traffic before the client pings the broker
_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.%]+\]|[^\s:/\[\]]+)(?::(\d{1,5}))?")
_LARGEST_FILE = 4_000_000  # [bytes], of certificates
_REFUSED = (134, 135)  # MQTT reason codes: bad user name or password, not authorized


class Broker(NamedTuple):
    """Where a broker is, and how to connect to it."""

    host: str
    port: int
    user: str | None = None
    context: ssl.SSLContext | None = None  # None: no TLS
    timeout: float = TIMEOUT

    @property
    def name(self) -> str:
        """The address as HOST:PORT."""
        return f"{self.host}:{self.port}"

    def client(self, **options: Any) -> Any:
        """Return a client to be entered; WarehouseError if aiomqtt is missing."""
        return package().Client(
            self.host, self.port, username=self.user, password=os.environ.get(PASSWORD), timeout=self.timeout,
            keepalive=KEEP_ALIVE, tls_context=self.context, **options,
        )  # fmt: skip


def package() -> Any:
    """Return the module aiomqtt; WarehouseError if it is missing."""
    try:
        return importlib.import_module("aiomqtt")
    except ImportError:
        raise WarehouseError("MQTT needs the package 'aiomqtt'; pip install \"warehouse-env[fleet]\"") from None


def broker_of(text: str, user: str | None = None, context: ssl.SSLContext | None = None) -> Broker:
    """Return the broker named by HOST or HOST:PORT; ConfigError if `text` is neither."""
    found = _ADDRESS.fullmatch(text)
    port = int(found[2] or (PORT if context is None else SECURE_PORT)) if found else 0
    if found is None or not 0 < port < 65536 or len(found[1]) > 253:
        raise ConfigError(f"{shown(text)} is no broker; name it as HOST or HOST:PORT")
    return Broker(found[1].strip("[]"), port, user, context)


def secure_context(authority: Path | None) -> ssl.SSLContext:
    """Return the TLS settings that trust the certificates in a file (None: those of this machine); ConfigError."""
    if authority is not None:
        read_bytes(authority, "--cafile", _LARGEST_FILE, ConfigError)
    try:
        context = ssl.create_default_context(cafile=None if authority is None else path_of(authority))
    except ssl.SSLError:
        raise ConfigError(f"--cafile {authority} holds no certificate in PEM format") from None
    if authority is not None:
        # Python 3.13 is stricter than brokers and their other clients: certificates of small authorities fail it.
        context.verify_flags &= ~ssl.VERIFY_X509_STRICT
    return context


class Sent(NamedTuple):
    """What was published."""

    messages: int
    late: float  # [s] that the latest message was behind its time


def publish(broker: Broker, messages: Iterable[Message], names: Names, serials: Iterable[str], speed: float) -> Sent:
    """Publish messages when they are due, each vehicle over its own connection with a last will.

    A vehicle's orders use its connection as well, so they never overtake its states.
    At the end, also after an error, online vehicles say OFFLINE. Raises WarehouseError if the broker cannot be reached,
    LostError if it goes away.
    """
    publisher = _Publisher(broker, {serial: Sender(names, serial) for serial in serials}, speed)
    try:
        return asyncio.run(publisher.run(messages))
    except (package().MqttError, UnicodeError) as error:
        if not publisher.began:
            raise _not_connected(broker, error) from None
        count = f"{publisher.count:,} messages were sent"
        raise LostError(f"broker {broker.name} no longer answers ({_reason(error)}); {count}") from None


class _Publisher:
    """The connections of a fleet."""

    def __init__(self, broker: Broker, senders: dict[str, Sender], speed: float) -> None:
        self._broker, self._senders, self._speed = broker, senders, speed
        self._online: dict[str, Any] = {}  # clients by serial number
        self._now = 0.0  # [s] of the messages
        self.count = 0
        self.began = False

    async def run(self, messages: Iterable[Message]) -> Sent:
        """Connect, publish all, and leave."""
        aiomqtt, clients = package(), dict[str, Any]()
        # the first error that is raised tells why a connection closed
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: None)
        async with contextlib.AsyncExitStack() as stack:
            for serial, sender in self._senders.items():
                will = sender.last_will()
                last = aiomqtt.Will(will.topic, will.text, will.qos, will.retain)
                clients[serial] = await stack.enter_async_context(self._broker.client(will=last))
            self.began = True
            try:
                return await self._publish(messages, clients)
            finally:
                with contextlib.suppress(aiomqtt.MqttError, TimeoutError):
                    await asyncio.wait_for(self._leave(), self._broker.timeout)

    async def _publish(self, messages: Iterable[Message], clients: dict[str, Any]) -> Sent:
        loop = asyncio.get_running_loop()
        begin, late = loop.time(), 0.0
        for message in messages:
            behind = loop.time() - begin - message.seconds / self._speed
            if behind < 0:
                await asyncio.sleep(-behind)
            late, self._now = max(late, behind), message.seconds
            serial, name = message.topic.split("/")[-2:]
            client = clients[serial]
            if name == "connection":
                if message.payload["connectionState"] == "ONLINE":
                    self._online[serial] = client
                else:
                    self._online.pop(serial, None)
            await client.publish(message.topic, message.text, message.qos, message.retain)
            self.count += 1
        return Sent(self.count, late)

    async def _leave(self) -> None:
        """Say OFFLINE for vehicles that are still online."""
        for serial, client in self._online.items():
            will, header = self._senders[serial].last_will(), self._senders[serial].header(self._now, 1)
            text = will._replace(payload=header | {"connectionState": "OFFLINE"}).text
            await client.publish(will.topic, text, will.qos, will.retain)


def _reason(error: Exception) -> str:
    """Return the text of a client's error, shortened."""
    cause = error.__cause__ or error.__context__ or error
    said = getattr(cause, "strerror", None) or str(error) or str(cause)
    return " ".join(said.split())[:200] or type(error).__name__


def _not_connected(broker: Broker, error: Exception) -> WarehouseError:
    """Return the error for a connection that could not be made: what is wrong, and what to do."""
    name, cause = f"broker {broker.name}", error.__context__
    if getattr(getattr(error, "rc", None), "value", None) in _REFUSED:
        who = "clients without a user" if broker.user is None else f"user {shown(broker.user)}"
        return WarehouseError(f"{name} refuses {who}; check --user and the password in {PASSWORD}")
    if isinstance(cause, ssl.SSLCertVerificationError):
        return WarehouseError(
            f"the certificate of {name} is not trusted ({cause.verify_message}); name its authority's file with "
            "--cafile, and the broker as its certificate does"
        )
    if isinstance(cause, ssl.SSLError):
        return WarehouseError(f"{name} does not answer in TLS at this port ({_reason(error)}); name its TLS port")
    if isinstance(cause, TimeoutError):
        return WarehouseError(
            f"{name} does not answer: check host and port; a TLS port needs --tls or --cafile, any other port neither"
        )
    return WarehouseError(f"{name} cannot be reached: {_reason(error)}")
