"""VDA 5050 messages: topics, headers with counters, quality of service, and lines of a log."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from warehouse_env.files import complete_file

VERSION = "2.1.0"  # of VDA 5050, which is written and checked
MAJOR = int(VERSION.partition(".")[0])
TOPICS = ("connection", "factsheet", "order", "state", "visualization")
LOG = "messages.jsonl"
"""Name of the log in the folder that `warehouse fleet` writes."""


class Message(NamedTuple):
    """One message as it is published."""

    seconds: float  # since the beginning
    topic: str  # as in "uagv/v2/ACME/0001/state"
    payload: dict[str, Any]
    qos: int
    retain: bool

    @property
    def text(self) -> str:
        """The payload as it is sent."""
        return json.dumps(self.payload, separators=(",", ":"), allow_nan=False)

    @property
    def line(self) -> str:
        """The line of a log, as `mosquitto_sub -F %J` prints it."""
        text, stamp = self.text, self.payload["timestamp"]
        about = {"tst": stamp, "topic": self.topic, "qos": self.qos, "retain": int(self.retain)}
        return f'{json.dumps(about)[:-1]}, "payloadlen": {len(text.encode())}, "payload": {text}}}\n'


@dataclass(frozen=True)
class Names:
    """First parts of a fleet's topics, and when its episode begins."""

    manufacturer: str
    interface: str
    begin: datetime

    def topic(self, serial: str, name: str) -> str:
        """Return the full name of a vehicle's topic."""
        return f"{self.interface}/v{MAJOR}/{self.manufacturer}/{serial}/{name}"

    def stamp(self, seconds: float) -> str:
        """Return a moment as a timestamp in UTC, to the millisecond."""
        moment = (self.begin + timedelta(milliseconds=round(seconds * 1000))).astimezone(UTC)
        return f"{moment.strftime('%Y-%m-%dT%H:%M:%S')}.{moment.microsecond // 1000:03d}Z"


class Sender:
    """Adds headers to the messages of one vehicle and to its orders; each topic has its own counter."""

    def __init__(self, names: Names, serial: str) -> None:
        self._names, self._serial = names, serial
        self._sent: Counter[str] = Counter()

    def message(self, seconds: float, name: str, body: dict[str, Any]) -> Message:
        """Return the message of a topic."""
        number = self._sent[name]
        self._sent[name] += 1
        lasting = name == "connection"  # the standard sends the others at most once
        header = self.header(seconds, number)
        return Message(seconds, self._names.topic(self._serial, name), header | body, int(lasting), lasting)

    def header(self, seconds: float, number: int) -> dict[str, Any]:
        """Return the header of a topic's message with this number, counted from 0."""
        return {
            "headerId": number, "timestamp": self._names.stamp(seconds), "version": VERSION,
            "manufacturer": self._names.manufacturer, "serialNumber": self._serial,
        }  # fmt: skip

    def last_will(self) -> Message:
        """Return what the broker publishes if the vehicle is cut off after its first connection message."""
        payload = self.header(0.0, 1) | {"connectionState": "CONNECTIONBROKEN"}
        return Message(0.0, self._names.topic(self._serial, "connection"), payload, 1, True)


def write_log(messages: Iterable[Message], folder: Path) -> int:
    """Write messages to FOLDER/messages.jsonl, completely or not at all; return their number."""
    count = 0
    with complete_file(folder / LOG) as part, part.open("w", encoding="utf-8") as file:
        for message in messages:
            file.write(message.line)
            count += 1
    return count
