"""Publish a fleet's messages over MQTT when they are due, each vehicle over a connection of its own."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from train.fleet.broker import Broker, hush, not_connected, package, reason
from train.fleet.messages import Message, Names, Sender
from warehouse_env.errors import LostError


class Sent(NamedTuple):
    """What was published."""

    messages: int
    late: float  # [s] that the latest message was behind its time


def publish(
    broker: Broker, messages: Iterable[Message], names: Names, serials: Iterable[str], speed: float,
    sent: Callable[[], object] = lambda: None,
) -> Sent:  # fmt: skip
    """Publish messages when they are due, each vehicle over its own connection with a last will.

    sent: called after each message. A vehicle's orders use its connection as well, so they never overtake its states.
    At the end, also after an error, online vehicles say OFFLINE. Raises WarehouseError if the broker cannot be reached,
    LostError if it goes away.
    """
    publisher = _Publisher(broker, {serial: Sender(names, serial) for serial in serials}, speed, sent)
    try:
        return asyncio.run(publisher.run(messages))
    except (package().MqttError, UnicodeError) as error:
        if not publisher.began:
            raise not_connected(broker, error) from None
        count = f"{publisher.count:,} messages were sent"
        raise LostError(f"broker {broker.name} no longer answers ({reason(error)}); {count}") from None


class _Publisher:
    """The connections of a fleet."""

    def __init__(self, broker: Broker, senders: dict[str, Sender], speed: float, sent: Callable[[], object]) -> None:
        self._broker, self._senders, self._speed, self._sent = broker, senders, speed, sent
        self._online: dict[str, Any] = {}  # clients by serial number
        self._now = 0.0  # [s] of the messages
        self.count = 0
        self.began = False

    async def run(self, messages: Iterable[Message]) -> Sent:
        """Connect, publish all, and leave."""
        aiomqtt, clients = package(), dict[str, Any]()
        hush()
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
            self._sent()
        return Sent(self.count, late)

    async def _leave(self) -> None:
        """Say OFFLINE for vehicles that are still online."""
        for serial, client in self._online.items():
            will, header = self._senders[serial].last_will(), self._senders[serial].header(self._now, 1)
            text = will._replace(payload=header | {"connectionState": "OFFLINE"}).text
            await client.publish(will.topic, text, will.qos, will.retain)
