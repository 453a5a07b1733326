"""A fleet's messages over MQTT: published as they fall due, or taken down as they come. Needs the package aiomqtt."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import os
import re
import ssl
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from typing import Any, NamedTuple

from train.fleet.log import Bad, Entry, decoded
from train.fleet.messages import MAJOR, TOPICS, Message, Names, Sender
from warehouse_env.errors import ConfigError, WarehouseError, shown

PORT, SECURE_PORT = 1883, 8883
PASSWORD = "WAREHOUSE_MQTT_PASSWORD"
"""Name of the variable of the environment that holds the password."""
TIMEOUT = 10.0  # [s] for which a broker may take for an answer
_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.%]+\]|[^\s:/\[\]]+)(?::(\d{1,5}))?")


class Broker(NamedTuple):
    """Where a broker is, and how to speak to it."""

    host: str
    port: int
    user: str | None = None
    secure: bool = False

    @property
    def name(self) -> str:
        """As it is typed."""
        return f"{self.host}:{self.port}"

    def client(self, **options: Any) -> Any:
        """Return a client, to be entered; WarehouseError where aiomqtt is missing."""
        return package().Client(
            self.host, self.port, username=self.user, password=os.environ.get(PASSWORD), timeout=TIMEOUT, keepalive=15,
            tls_context=ssl.create_default_context() if self.secure else None, **options,
        )  # fmt: skip


def package() -> Any:
    """Return the module aiomqtt; WarehouseError where it is missing."""
    try:
        return importlib.import_module("aiomqtt")
    except ImportError:
        raise WarehouseError("MQTT needs the package 'aiomqtt'; pip install \"warehouse-env[fleet]\"") from None


def broker_of(text: str, user: str | None = None, secure: bool = False) -> Broker:
    """Return the broker of HOST or HOST:PORT; ConfigError for what is neither."""
    found = _ADDRESS.fullmatch(text)
    port = int(found[2] or (SECURE_PORT if secure else PORT)) if found else 0
    if found is None or not 0 < port < 65536 or len(found[1]) > 253:
        raise ConfigError(f"{shown(text)} is no broker; name it as HOST or HOST:PORT")
    return Broker(found[1].strip("[]"), port, user, secure)


class Sent(NamedTuple):
    """What was published."""

    messages: int
    late: float  # [s] that the latest message was behind its time


def publish(
    broker: Broker, messages: Iterable[Message], names: Names, serials: Iterable[str], speed: float,
    sent: Callable[[], object] = lambda: None,
) -> Sent:  # fmt: skip
    """Publish messages as they fall due, each vehicle by a connection of its own, whose last will it leaves.

    sent: called after each message. A vehicle's orders go by its connection, too, so that nobody gets them before the
    states that they come after. Whatever ends it, vehicles that were online say that they are not. Raises
    WarehouseError where the broker cannot be reached, or is gone.
    """
    publisher = _Publisher(broker, names, list(serials), speed, sent)
    try:
        return asyncio.run(publisher.run(messages))
    except package().MqttError as error:
        if not publisher.began:
            raise WarehouseError(f"broker {broker.name} cannot be reached: {_reason(error)}") from None
        count = f"{publisher.count:,} messages were sent"
        raise WarehouseError(f"broker {broker.name} answers no more ({_reason(error)}); {count}") from None


class _Publisher:
    """The connections of a fleet."""

    def __init__(
        self, broker: Broker, names: Names, serials: list[str], speed: float, sent: Callable[[], object]
    ) -> None:
        self._broker, self._speed, self._sent = broker, speed, sent
        self._senders = {serial: Sender(names, serial) for serial in serials}
        self._online: dict[str, Any] = {}  # clients by serial number
        self._now = 0.0  # [s] of the messages
        self.count = 0
        self.began = False

    async def run(self, messages: Iterable[Message]) -> Sent:
        """Connect, publish all, and leave."""
        package_, clients = package(), dict[str, Any]()
        _hush()
        async with contextlib.AsyncExitStack() as stack:
            for serial, sender in self._senders.items():
                will = sender.last_will()
                last = package_.Will(will.topic, will.text, will.qos, will.retain)
                clients[serial] = await stack.enter_async_context(self._broker.client(will=last))
            self.began = True
            try:
                return await self._publish(messages, clients)
            finally:
                with contextlib.suppress(package_.MqttError, TimeoutError):
                    await asyncio.wait_for(self._leave(), TIMEOUT)

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
            self._sent()
        return Sent(self.count, late)

    async def _leave(self) -> None:
        """Say of those that are still online that they are not any more."""
        for serial, client in self._online.items():
            word = self._senders[serial].last_will()
            stamp = self._senders[serial].header(self._now, 1)
            text = word._replace(payload=stamp | {"connectionState": "OFFLINE"}).text
            await client.publish(word.topic, text, word.qos, word.retain)


def receive(
    broker: Broker, interface: str, take: Callable[[str, Entry | Bad], bool], patience: float, seconds: float | None
) -> str:
    """Hand over what vehicles publish, and when it came, until `take` returns True; return why it ended.

    That is also when nothing has come for `patience` seconds, and after so many `seconds`. Raises WarehouseError where
    the broker cannot be reached; one that goes away later only ends it.
    """
    try:
        return asyncio.run(_receive(broker, f"{interface}/{MAJOR}/+/+/", take, patience, seconds))
    except package().MqttError as error:
        raise WarehouseError(f"broker {broker.name} cannot be reached: {_reason(error)}") from None


async def _receive(
    broker: Broker, topics: str, take: Callable[[str, Entry | Bad], bool], patience: float, seconds: float | None
) -> str:
    loop = asyncio.get_running_loop()
    _hush()
    end = loop.time() + seconds if seconds is not None else float("inf")
    async with broker.client() as client:
        await client.subscribe([(topics + name, int(name == "connection")) for name in (*TOPICS, "instantActions")])
        messages = aiter(client.messages)
        while True:
            left = end - loop.time()
            try:
                message = await asyncio.wait_for(anext(messages), max(min(patience, left), 0.0))
            except TimeoutError:
                return f"{seconds:g} s are over" if left <= patience else f"nothing came for {patience:g} s"
            except package().MqttError as error:
                return f"broker {broker.name} is gone ({_reason(error)})"
            payload = message.payload if isinstance(message.payload, bytes) else str(message.payload).encode()
            data = decoded(payload)
            entry = data if isinstance(data, Bad) else Entry(str(message.topic), data, message.qos, message.retain)
            if take(datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"), entry):
                return "all vehicles are offline"


def _hush() -> None:
    """Let nothing be printed of connections that ended: the first error that is raised says it."""
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: None)


def _reason(error: Exception) -> str:
    """Return what a client's error says, in a few words."""
    inner = error.__cause__ if not str(error) and error.__cause__ is not None else error
    return " ".join(str(inner).split())[:200] or type(error).__name__
