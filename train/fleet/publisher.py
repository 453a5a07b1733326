"""Publish a fleet's messages to an MQTT broker when they are due, each vehicle over its own connection.

Needs the package aiomqtt.
"""

import asyncio
import contextlib
import importlib
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

from train.fleet.messages import Message, Names, Sender
from warehouse_env.errors import ConfigError, LostError, WarehouseError, shown

PORT = 1883
TIMEOUT = 10.0  # [s] to wait for an answer of the broker
KEEP_ALIVE = 15  # [s] without traffic before the client pings the broker
_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.%]+\]|[^\s:/\[\]]+)(?::(\d{1,5}))?")
_REFUSED = (134, 135)  # MQTT reason codes: bad user name or password, not authorized
_BRIDGE = "publish to a local broker that bridges to it"


class Broker(NamedTuple):
    """Where a broker is that asks for neither TLS nor a password."""

    host: str
    port: int
    timeout: float = TIMEOUT

    @property
    def name(self) -> str:
        """The address as HOST:PORT."""
        return f"{self.host}:{self.port}"

    def client(self, **options: Any) -> Any:
        """Return a client to be entered; WarehouseError if aiomqtt is missing."""
        return package().Client(self.host, self.port, timeout=self.timeout, keepalive=KEEP_ALIVE, **options)


def package() -> Any:
    """Return the module aiomqtt; WarehouseError if it is missing."""
    try:
        return importlib.import_module("aiomqtt")
    except ImportError:
        raise WarehouseError("MQTT needs the package 'aiomqtt'; pip install \"warehouse-env[fleet]\"") from None


def broker_of(text: str) -> Broker:
    """Return the broker named by HOST or HOST:PORT; ConfigError if `text` is neither."""
    found = _ADDRESS.fullmatch(text)
    port = int(found[2] or PORT) if found else 0
    if found is None or not 0 < port < 65536 or len(found[1]) > 253:
        raise ConfigError(f"{shown(text)} is no broker; name it as HOST or HOST:PORT")
    return Broker(found[1].strip("[]"), port)


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
    name = f"broker {broker.name}"
    if getattr(getattr(error, "rc", None), "value", None) in _REFUSED:
        return WarehouseError(f"{name} refuses clients without a password; {_BRIDGE}")
    if isinstance(error.__context__, TimeoutError):
        return WarehouseError(f"{name} does not answer: check host and port; if the port needs TLS, {_BRIDGE}")
    return WarehouseError(f"{name} cannot be reached: {_reason(error)}")
