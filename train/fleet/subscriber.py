"""What a fleet's vehicles publish, taken in as it comes; a connection that breaks is made again."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from train.fleet.broker import Broker, hush, package, reason
from train.fleet.greeting import greet
from train.fleet.log import Bad, Entry, decoded
from train.fleet.messages import TOPICS
from warehouse_env.errors import LostError, WarehouseError, shown

AGAIN = 1.0  # [s] between two tries to connect again
Take = Callable[[str, Entry | Bad], bool]
"""Takes a message and when it came; returns whether that was the last."""


def receive(
    broker: Broker, interface: str, take: Take, missed: Callable[[float], object], patience: float,
    seconds: float | None,
) -> str:  # fmt: skip
    """Hand over what vehicles publish, until `take` returns True; return why it ended.

    That is also when nothing has come for `patience` seconds, and after so many `seconds`. A connection that breaks is
    made again for `patience` seconds; missed: called with how long nothing was heard. Raises WarehouseError where the
    broker cannot be reached, LostError where it goes away and does not come back.
    """
    greet(broker)
    return asyncio.run(_Subscriber(broker, interface, take, missed, patience, seconds).run())


class _Subscriber:
    """One who listens, over one connection after the other."""

    def __init__(
        self, broker: Broker, interface: str, take: Take, missed: Callable[[float], object], patience: float,
        seconds: float | None,
    ) -> None:  # fmt: skip
        self._broker, self._interface, self._take, self._missed = broker, interface, take, missed
        self._patience, self._seconds = patience, seconds
        self._end = float("inf")
        self._listens = False  # or has done so before
        self._broke: float | None = None  # when, if nothing has come since

    async def run(self) -> str:
        """Listen; return why it ended."""
        hush()
        if self._seconds is not None:
            self._end = self._now() + self._seconds
        try:
            while True:
                try:
                    return await self._listen()
                except package().MqttError as error:
                    await self._wait(error)
        finally:
            self._heard()

    def _now(self) -> float:
        return asyncio.get_running_loop().time()

    async def _wait(self, error: Exception) -> None:
        """Wait for the next try to connect; raise LostError where it is time to give up."""
        if not self._listens:
            raise WarehouseError(f"broker {self._broker.name} cannot be reached: {reason(error)}") from None
        self._broke = self._now() if self._broke is None else self._broke
        left = min(self._broke + self._patience, self._end) - self._now()
        if left <= 0:
            away = self._now() - self._broke
            raise LostError(
                f"broker {self._broker.name} went away ({reason(error)}) and did not come back within {away:.0f} s"
            ) from None
        await asyncio.sleep(min(AGAIN, left))

    def _heard(self) -> None:
        """Something came, or it is the end: tell for how long nothing did if the connection broke before."""
        if self._broke is not None:
            self._missed(self._now() - self._broke)
            self._broke = None

    async def _listen(self) -> str:
        """Listen over one connection."""
        async with self._broker.client() as client:
            await self._subscribe(client)
            self._listens = True
            messages = aiter(client.messages)
            while True:
                left = self._end - self._now()
                try:
                    message = await asyncio.wait_for(anext(messages), max(min(self._patience, left), 0.0))
                except TimeoutError:
                    over = left <= self._patience
                    return f"{self._seconds:g} s are over" if over else f"nothing came for {self._patience:g} s"
                self._heard()
                if self._take(
                    datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"), _of(message)
                ):
                    return "all vehicles are offline"

    async def _subscribe(self, client: Any) -> None:
        """Ask for the topics of all vehicles, with and without a version in them, whichever it is."""
        topics = [
            (f"{self._interface}/{levels}/{name}", int(name == "connection"))
            for levels in ("+/+/+", "+/+")
            for name in (*TOPICS, "instantActions")
        ]
        granted = await client.subscribe(topics)
        if all(code.is_failure for code in granted):
            who = "anybody" if self._broker.user is None else f"user {shown(self._broker.user)}"
            raise WarehouseError(
                f"broker {self._broker.name} does not let {who} read below {self._interface}/; have it allowed, or "
                "name another --user or --interface"
            )


def _of(message: Any) -> Entry | Bad:
    """Return what a message of aiomqtt holds."""
    payload = message.payload if isinstance(message.payload, bytes) else str(message.payload).encode()
    data = decoded(payload)
    return data if isinstance(data, Bad) else Entry(str(message.topic), data, message.qos, message.retain)
