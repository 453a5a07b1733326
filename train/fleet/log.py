"""Logs of MQTT messages as JSON lines, as `mosquitto_sub -F %J` prints them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from train.fleet.messages import LOG
from warehouse_env.errors import WarehouseError, shown
from warehouse_env.files import path_of, text_lines
from warehouse_env.format_version import major_of

LONGEST = 4_000_000  # characters of a line
_LARGEST_FILE = 10**12  # [bytes]


class LogEntry(NamedTuple):
    """A message as it was logged."""

    topic: str
    payload: dict[str, Any]
    qos: int | None
    retain: bool | None


class Bad(NamedTuple):
    """A line that is no message."""

    why: str


def log_path(given: Path) -> Path:
    """Return the path of a log: the file itself, or the one in the folder."""
    path = path_of(given)
    return path / LOG if path.is_dir() else path


def read_log(path: Path) -> Iterator[tuple[int, LogEntry | Bad]]:
    """Yield each non-empty line with its number, from 1; WarehouseError if the file cannot be read."""
    for number, line in text_lines(path, "log of messages", _LARGEST_FILE, LONGEST, WarehouseError):
        if line.strip():
            yield number, entry_of(line.encode("utf-8", "surrogateescape"))


def entry_of(line: bytes) -> LogEntry | Bad:
    """Parse a line of a log."""
    try:
        data = json.loads(line)
    except (ValueError, RecursionError) as error:
        return Bad(f"it is no JSON: {shown(str(error))}")
    if not isinstance(data, dict):
        return Bad("it is no JSON object")
    topic, payload = data.get("topic"), data.get("payload")
    if not isinstance(topic, str):
        return Bad("it has no topic")
    if not isinstance(payload, dict):
        return Bad("its payload is no JSON object")
    qos, retain = data.get("qos"), data.get("retain")
    return LogEntry(topic, payload, qos if qos in (0, 1, 2) else None, bool(retain) if retain in (0, 1) else None)


def moment_of(stamp: object, zoned: bool = False) -> float | None:
    """Return the seconds since 1970 of an ISO 8601 timestamp, None if it is none.

    zoned: a zone is required; otherwise a timestamp without one is UTC.
    """
    if not isinstance(stamp, str) or len(stamp) > 40:
        return None
    try:
        moment = datetime.fromisoformat(stamp.upper())  # RFC 3339 allows a small z
        if moment.tzinfo is None:
            return None if zoned else moment.replace(tzinfo=UTC).timestamp()
        return moment.timestamp()
    except (ValueError, OverflowError):
        return None


def version_of(entry: LogEntry) -> tuple[str, int | None]:
    """Return the version of a message, or else of its topic: as written, and its major number or None."""
    level = "".join(entry.topic.split("/")[-4:-3])
    for said in (entry.payload.get("version"), level if level[:1] in ("v", "V") else None):
        if (major := major_of(said)) is not None:
            return str(said), major
    return "", None
