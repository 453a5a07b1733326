"""Receive the messages of vehicles from a log, or from a broker, which are logged at once."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, NamedTuple

from train.fleet.broker import Broker, hush, not_connected, package, reason
from train.fleet.log import Bad, LogEntry, decoded, log_path, read_log
from train.fleet.messages import LOG, TOPICS, log_line
from train.fleet.received import HeardFleet
from warehouse_env.errors import ConfigError, LostError, WarehouseError, shown

AGAIN = 1.0  # [s] between two attempts to reconnect


class Heard(NamedTuple):
    """The messages received, and how it ended."""

    fleet: HeardFleet
    why: str
    stopped: BaseException | None = None  # what interrupted it


class ListenLimits(NamedTuple):
    """When to stop listening to a broker [s]."""

    patience: float  # without a message or a connection
    seconds: float | None = None  # in all


def hear_log(given: Path, moved: Callable[[], object] = lambda: None) -> Heard:
    """Read a log file, or the one in a folder; moved: called after each line."""
    fleet = HeardFleet()
    for _, entry in read_log(log_path(given)):
        fleet.add(entry)
        moved()
    return Heard(fleet, "the log ends")


def hear_broker(
    broker: Broker, interface: str, folder: Path, limits: ListenLimits, moved: Callable[[], object] = lambda: None
) -> Heard:
    """Listen to a broker and append each message to FOLDER/messages.jsonl; moved: called after each message.

    Ctrl-C or a lost broker after the first message is returned in the result, since what came is still used. Raises
    WarehouseError if the broker cannot be reached or nothing comes, LostError if it is lost before the first message.
    """
    path, fleet = folder / LOG, HeardFleet()
    if path.exists():
        raise ConfigError(f"{path} holds messages already; name another folder with --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8", buffering=1) as file:
            why = asyncio.run(_Listener(broker, interface, limits, fleet, file, moved).run())
        if not fleet.messages:
            raise WarehouseError(f"no vehicle said anything at {broker.name} under {interface}/: {why}")
    except (KeyboardInterrupt, WarehouseError) as error:
        if fleet.messages:
            return Heard(fleet, "the broker is gone" if isinstance(error, LostError) else "it was stopped", error)
        path.unlink(missing_ok=True)
        raise
    except OSError as error:
        raise WarehouseError(f"cannot write {path}: {error.strerror or error}") from None
    return Heard(fleet, why)


class _Listener:
    """Listens over one connection after another."""

    def __init__(
        self,
        broker: Broker,
        interface: str,
        limits: ListenLimits,
        fleet: HeardFleet,
        file: IO[str],
        moved: Callable[[], object],
    ) -> None:
        self._broker, self._interface, self._limits = broker, interface, limits
        self._fleet, self._file, self._moved = fleet, file, moved
        self._end = math.inf
        self._listened = False  # over any connection so far
        self._broke: float | None = None  # when the connection broke, if nothing has come since

    async def run(self) -> str:
        """Listen; return why it ended."""
        hush()
        if self._limits.seconds is not None:
            self._end = self._now() + self._limits.seconds
        try:
            while True:
                try:
                    return await self._listen()
                except (package().MqttError, UnicodeError) as error:
                    await self._wait(error)
        finally:
            self._note_gap()

    def _now(self) -> float:
        return asyncio.get_running_loop().time()

    async def _wait(self, error: Exception) -> None:
        """Wait before the next attempt to connect; raise if there is none."""
        if not self._listened:
            raise not_connected(self._broker, error) from None
        self._broke = self._now() if self._broke is None else self._broke
        left = min(self._broke + self._limits.patience, self._end) - self._now()
        if left <= 0:
            away = self._now() - self._broke
            raise LostError(
                f"broker {self._broker.name} went away ({reason(error)}) and did not come back within {away:.0f} s"
            ) from None
        await asyncio.sleep(min(AGAIN, left))

    def _note_gap(self) -> None:
        """Note how long nothing was heard after the connection broke."""
        if self._broke is not None:
            self._fleet.gaps.append(self._now() - self._broke)
            self._broke = None

    async def _listen(self) -> str:
        """Listen over one connection."""
        patience = self._limits.patience
        async with self._broker.client() as client:
            await self._subscribe(client)
            self._listened = True
            messages = aiter(client.messages)
            while not self._fleet.gone:
                left = self._end - self._now()
                try:
                    message = await asyncio.wait_for(anext(messages), max(min(patience, left), 0.0))
                except TimeoutError:
                    over = left <= patience
                    return f"{self._limits.seconds:g} s are over" if over else f"nothing came for {patience:g} s"
                self._note_gap()
                self._take(message)
        return "all vehicles are offline"

    async def _subscribe(self, client: Any) -> None:
        """Subscribe to the topics of all vehicles, of any version."""
        topics = [
            (f"{self._interface}/+/+/+/{name}", int(name == "connection")) for name in (*TOPICS, "instantActions")
        ]
        granted = await client.subscribe(topics)
        if all(code.is_failure for code in granted):
            who = "anybody" if self._broker.user is None else f"user {shown(self._broker.user)}"
            raise WarehouseError(
                f"broker {self._broker.name} does not let {who} read below {self._interface}/; have it allowed, or "
                "name another --user or --interface"
            )

    def _take(self, message: Any) -> None:
        """Log and keep a message."""
        payload = message.payload if isinstance(message.payload, bytes) else str(message.payload).encode()
        data = decoded(payload)
        if isinstance(data, Bad):
            self._fleet.add(data)
            return
        entry = LogEntry(str(message.topic), data, message.qos, message.retain)
        if self._fleet.is_stale(entry):
            return
        received = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        with contextlib.suppress(RecursionError):  # of JSON that is nested too deeply to be written
            self._file.write(log_line(received, entry.topic, message.qos, message.retain, json.dumps(data)))
            self._fleet.add(entry)
        self._moved()
