"""Check a log of messages against VDA 5050 by official schemas and rules, independent of what writes messages."""

import functools
import importlib
import json
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from train.fleet.messages import TOPICS, VERSIONS, Bad, LogEntry, log_path, moment_of, read_log, version_of
from train.fleet.order_rules import OrderBook
from warehouse_env.errors import WarehouseError, shown
from warehouse_env.format_version import major_of

SCHEMAS = Path(__file__).with_name("schemas")
_VERSION = re.compile(r"\d+\.\d+\.\d+", re.ASCII)
_LATEST = 30.0  # [s] after which a state is due
_SHOWN = 100  # faults that are kept; the others are counted
_READ = " and ".join(f"{major}.x" for major in VERSIONS)
_BROKEN = ("CONNECTIONBROKEN", "CONNECTION_BROKEN")  # in versions 2 and 3
_UNCHECKED = {2: ("instantActions",), 3: ("instantActions", "responses", "zoneSet")}  # other topics


class LogFault(NamedTuple):
    """A fault in a log."""

    line: int
    vehicle: str
    kind: str  # version, schema, header, time, quality, connection, order, state
    what: str

    @property
    def sentence(self) -> str:
        """The fault in words."""
        return f"line {self.line}, {self.vehicle}: {self.kind}: {self.what}"


class LogCheck(NamedTuple):
    """What a check found."""

    messages: Counter[str]  # by topic
    vehicles: int
    seconds: float  # from the first message to the last
    faults: list[LogFault]  # the first of them
    total: int  # of all faults


@functools.cache
def validator(major: int, name: str) -> Any:
    """Return the validator of a topic's messages by the official schema of a version."""
    try:
        jsonschema = importlib.import_module("jsonschema")
    except ImportError:
        raise WarehouseError("--check needs the package 'jsonschema'; pip install \"warehouse-env[fleet]\"") from None
    schema = (SCHEMAS / f"v{major}" / f"{name}.schema").read_text(encoding="utf-8")
    return jsonschema.Draft202012Validator(json.loads(schema))


def check_log(given: Path, moved: Callable[[], object] = lambda: None) -> LogCheck:
    """Check a log, or the one in a folder; moved: called after each line. WarehouseError if there is none."""
    checker = _Checker()
    for number, entry in read_log(log_path(given)):
        checker.take(number, entry)
        moved()
    if not checker.messages:
        unread = " and ".join(map(shown, checker.unread.values()))
        what = f"is of version {unread} of VDA 5050; --check reads {_READ}"
        raise WarehouseError(f"{log_path(given)} {what if unread else 'holds no message of VDA 5050'}")
    return checker.done()


class _Vehicle:
    """The state of the check of one vehicle."""

    def __init__(self) -> None:
        self.versions: set[str] = set()  # odd ones, reported once each
        self.headers: dict[str, int] = {}
        self.times: dict[str, float] = {}
        self.online = False
        self.connection: dict[str, Any] = {}  # the last message
        self.stated: float | None = None  # moment of the last state, while it is online
        self.orders = OrderBook()

    def overdue(self, now: float) -> Iterator[tuple[str, str]]:
        """Yield a fault if a state was due."""
        if self.stated is not None and now - self.stated > _LATEST + 1e-3:
            yield "time", f"no state for {now - self.stated:.1f} s"


class _Checker:
    """Checks the lines of a log."""

    def __init__(self) -> None:
        self.messages: Counter[str] = Counter()
        self.unread: dict[int, str] = {}  # major version that is not read -> as it was first written
        self._vehicles: defaultdict[str, _Vehicle] = defaultdict(_Vehicle)
        self._faults: list[LogFault] = []
        self._count = 0
        self._first: float | None = None
        self._last = 0.0
        self._line = 0

    def take(self, number: int, entry: LogEntry | Bad) -> None:
        """Check one line."""
        self._line = number
        if isinstance(entry, Bad):
            self._note("no vehicle", "header", entry.why)
            return
        parts = entry.topic.split("/")[-5:]  # an interface's name may have several levels
        key = "/".join(parts[2:4]) if len(parts) == 5 else "no vehicle"
        for kind, what in self._taken(key, parts, entry):
            self._note(key, kind, what)

    def done(self) -> LogCheck:
        """Return what was found."""
        for key, vehicle in self._vehicles.items():
            for kind, what in vehicle.overdue(self._last):
                self._note(key, kind, what)
        seconds = self._last - self._first if self._first is not None else 0.0
        return LogCheck(self.messages, len(self._vehicles), seconds, self._faults, self._count)

    def _note(self, key: str, kind: str, what: str) -> None:
        self._count += 1
        if len(self._faults) < _SHOWN:
            self._faults.append(LogFault(self._line, key, kind, what))

    def _taken(self, key: str, parts: list[str], entry: LogEntry) -> Iterator[tuple[str, str]]:
        """Yield the faults of a message, kind and sentence; each version that is not read is one fault."""
        version, major = version_of(entry)
        major = min(VERSIONS) if major is None else major
        if major not in VERSIONS:
            if major not in self.unread:
                self.unread[major] = version
                yield "version", f"{shown(version)} is not read; --check reads {_READ} and skips the others"
            return
        name = parts[-1]
        if len(parts) != 5 or name not in (*TOPICS, *_UNCHECKED[major]):
            yield "header", f"the topic {shown(entry.topic)} is not INTERFACE/VERSION/MANUFACTURER/SERIAL/TOPIC"
            return
        if name == "connection" and self._is_old(key, entry):
            return
        vehicle = self._vehicles[key]
        self.messages[name] += 1
        if name == "instantActions":
            vehicle.orders.act(entry.payload)
        if name in _UNCHECKED[major]:
            return
        fault = _schema_fault(major, name, entry.payload)
        if fault:
            yield "schema", fault
            return
        yield from self._header(vehicle, name, parts, entry.payload)
        yield from self._content(vehicle, name, entry)

    def _content(self, vehicle: _Vehicle, name: str, entry: LogEntry) -> Iterator[tuple[str, str]]:
        """Yield the faults of a message whose form and header are checked."""
        wanted = int(name == "connection")
        if entry.qos is not None and entry.qos != wanted:
            yield "quality", f"{name} is sent with QoS {entry.qos}, not {wanted}"
        if name == "connection":
            yield from self._connection(vehicle, entry.payload)
        elif name == "order":
            yield from (("order", what) for what in vehicle.orders.order(entry.payload))
        elif name == "state":
            now = vehicle.times.get("state", self._last)
            yield from vehicle.overdue(now)
            vehicle.stated = now
            yield from (("state", what) for what in vehicle.orders.state(entry.payload))
        elif name == "visualization":
            told, last = entry.payload.get("referenceStateHeaderId"), vehicle.headers.get("state")  # of version 3
            if isinstance(told, int) and last is not None and told > last:
                yield "header", f"this visualization refers to state {told}; the last one sent is {last}"

    def _is_old(self, key: str, entry: LogEntry) -> bool:
        """Whether a connection message was retained from before, or is delivered twice."""
        vehicle = self._vehicles.get(key)
        if vehicle is None:
            return bool(entry.retain) and entry.payload.get("connectionState") != "ONLINE"
        return vehicle.connection == entry.payload

    def _header(
        self, vehicle: _Vehicle, name: str, parts: list[str], payload: dict[str, Any]
    ) -> Iterator[tuple[str, str]]:
        number, before = payload.get("headerId"), vehicle.headers.get(name)
        if not isinstance(number, int):
            yield "header", f"this {name} has no headerId"
        else:
            if before is not None and number != before + 1:
                yield "header", f"headerId {number} of {name} stands after {before}"
            vehicle.headers[name] = number
        whose = (payload.get("manufacturer"), payload.get("serialNumber"))
        if whose != (parts[2], parts[3]):
            yield "header", f"it names vehicle {shown(whose)}, its topic another one"
        level, version = parts[1], payload["version"]
        wrong = not _VERSION.fullmatch(version), f"v{major_of(version)}" != level
        if any(wrong) and f"{level}/{version}" not in vehicle.versions:  # once a vehicle
            vehicle.versions.add(f"{level}/{version}")
            what = "is not MAJOR.MINOR.PATCH" if wrong[0] else f"is not that of the topic, {shown(level)}"
            yield "version", f"{shown(version)} {what}"
        now = moment_of(payload.get("timestamp"), zoned=True)
        if now is None:
            yield "time", f"timestamp {shown(payload.get('timestamp'))} is not ISO 8601 in UTC"
        elif payload.get("connectionState") not in _BROKEN:  # which is as old as the connection
            if now < vehicle.times.get(name, now):
                yield "time", f"the timestamp of this {name} is before that of the last"
            vehicle.times[name] = now
            self._first = now if self._first is None else min(self._first, now)
            self._last = max(self._last, now)

    def _connection(self, vehicle: _Vehicle, payload: dict[str, Any]) -> Iterator[tuple[str, str]]:
        state, vehicle.connection = payload["connectionState"], payload
        if state != "ONLINE":  # no state is due any more
            yield from vehicle.overdue(vehicle.times.get("connection", self._last))
            vehicle.stated = None
        if vehicle.online and state == "ONLINE":
            yield "connection", "ONLINE again without having been offline"
        if not vehicle.online and state != "ONLINE" and payload["headerId"] == 0:
            yield "connection", f"its first connection message is {state}"
        vehicle.online = state == "ONLINE"


def _schema_fault(major: int, name: str, payload: dict[str, Any]) -> str:
    """Return what is wrong with a message by the official schema, "" if nothing is."""
    try:
        error = next(validator(major, name).iter_errors(payload), None)
    except RecursionError:
        return f"this {name} is nested too deeply"
    if error is None:
        return ""
    where = "/".join(map(str, error.absolute_path)) or "the message"
    return f"in this {name}, {shown(where)}: {shown(error.message)}"
