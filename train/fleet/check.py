"""Is a log of messages what VDA 5050 2.1.0 asks for? Checked apart from what writes one, by schemas and by rules."""

from __future__ import annotations

import functools
import importlib
import json
import re
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from train.fleet.log import Bad, Entry, log_path, moment_of, read_log, version_of
from train.fleet.order_rules import OrderBook
from warehouse_env.errors import WarehouseError, shown
from warehouse_env.format_version import major_of

SCHEMAS = Path(__file__).with_name("schemas")
NAMES = ("connection", "factsheet", "order", "state", "visualization")
_READS = 2  # major version
_VERSION = re.compile(r"\d+\.\d+\.\d+", re.ASCII)
_LATEST = 30.0  # [s] after which a state is due
_SHOWN = 100  # faults that are kept; the others are counted


class Fault(NamedTuple):
    """What is wrong, and where."""

    line: int
    vehicle: str
    kind: str  # version, schema, header, time, quality, connection, order, state
    what: str

    @property
    def sentence(self) -> str:
        """It in words."""
        return f"line {self.line}, {self.vehicle}: {self.kind}: {self.what}"


class Checked(NamedTuple):
    """What a check found."""

    messages: Counter[str]  # by topic
    vehicles: int
    seconds: float  # from the first message to the last
    faults: list[Fault]
    total: int  # of faults, those that are not kept among them


@functools.cache
def validator(name: str) -> Any:
    """Return what validates messages of a topic by the official schema."""
    try:
        jsonschema = importlib.import_module("jsonschema")
    except ImportError:
        raise WarehouseError("--check needs the package 'jsonschema'; pip install \"warehouse-env[fleet]\"") from None
    return jsonschema.Draft202012Validator(json.loads((SCHEMAS / f"{name}.schema").read_text(encoding="utf-8")))


def check_log(given: Path, moved: Callable[[], object] = lambda: None) -> Checked:
    """Check a log, or the one in a folder; moved: called after each line. WarehouseError where there is none."""
    checker = _Checker()
    for number, entry in read_log(log_path(given)):
        checker.take(number, entry)
        moved()
    if not checker.messages:
        unread = " and ".join(map(shown, checker.unread.values()))
        is_of = (
            f"is of version {unread} of VDA 5050; --check reads {_READS}.x"
            if unread
            else "holds no message of VDA 5050"
        )
        raise WarehouseError(f"{log_path(given)} {is_of}")
    return checker.done()


class _Vehicle:
    """What is known of one vehicle."""

    def __init__(self) -> None:
        self.versions: set[str] = set()  # odd ones, told once each
        self.headers: dict[str, int] = {}
        self.times: dict[str, float] = {}
        self.online = False
        self.connection: dict[str, Any] = {}  # the last of its messages
        self.said: float | None = None  # when it last told its state
        self.orders = OrderBook()


class _Checker:
    """Takes a log's lines."""

    def __init__(self) -> None:
        self.messages: Counter[str] = Counter()
        self.unread: dict[int, str] = {}  # major version that is not read -> as it was first written
        self._vehicles: defaultdict[str, _Vehicle] = defaultdict(_Vehicle)
        self._faults: list[Fault] = []
        self._count = 0
        self._first: float | None = None
        self._last = 0.0
        self._where = (0, "")

    def take(self, number: int, entry: Entry | Bad) -> None:
        """Check one line."""
        self._where = (number, "no vehicle")
        if isinstance(entry, Bad):
            self._note("header", entry.why)
            return
        parts = (entry.topic or "").split("/")[-5:]  # an interface's name may have several levels
        if len(parts) == 5:
            self._where = (number, "/".join(parts[2:4]))
        if not self._is_read(entry):
            return
        if len(parts) != 5 or parts[4] not in (*NAMES, "instantActions"):
            self._note("header", f"the topic {shown(entry.topic)} is not INTERFACE/VERSION/MANUFACTURER/SERIAL/TOPIC")
            return
        name, key = parts[4], "/".join(parts[2:4])
        if name == "connection" and self._is_old(key, entry):
            return
        vehicle, payload = self._vehicles[key], entry.payload
        self.messages[name] += 1
        if name == "instantActions":
            vehicle.orders.act(payload)
            return
        if self._schema(name, payload):
            self._header(vehicle, name, parts, payload)
            self._quality(name, entry)
            getattr(self, f"_{name}", lambda *_: None)(vehicle, payload)

    def done(self) -> Checked:
        """Return what was found."""
        for key, vehicle in self._vehicles.items():
            self._where = (self._where[0], key)
            self._due(vehicle, self._last)
        seconds = self._last - self._first if self._first is not None else 0.0
        return Checked(self.messages, len(self._vehicles), seconds, self._faults, self._count)

    def _is_read(self, entry: Entry) -> bool:
        """Whether a message is of a version that is checked; each other version is one fault."""
        version, major = version_of(entry)
        if major is None or major == _READS:
            return True
        if major not in self.unread:
            self.unread[major] = version
            self._note("version", f"{shown(version)} is not read; --check reads {_READS}.x and skips the others")
        return False

    def _is_old(self, key: str, entry: Entry) -> bool:
        """Whether a connection's message is what the broker has kept from before, or delivers a second time."""
        vehicle = self._vehicles.get(key)
        if vehicle is None:
            return bool(entry.retain) and entry.payload.get("connectionState") != "ONLINE"
        return vehicle.connection == entry.payload

    def _note(self, kind: str, what: str) -> None:
        self._count += 1
        if len(self._faults) < _SHOWN:
            self._faults.append(Fault(*self._where, kind, what))

    def _schema(self, name: str, payload: dict[str, Any]) -> bool:
        try:
            error = next(validator(name).iter_errors(payload), None)
        except RecursionError:
            self._note("schema", f"this {name} is nested too deeply")
            return False
        if error is not None:
            where = "/".join(map(str, error.absolute_path)) or "the message"
            self._note("schema", f"in this {name}, {shown(where)}: {shown(error.message)}")
        return error is None

    def _header(self, vehicle: _Vehicle, name: str, parts: list[str], payload: dict[str, Any]) -> None:
        number, before = payload.get("headerId"), vehicle.headers.get(name)
        if not isinstance(number, int):
            self._note("header", f"this {name} has no headerId")
        else:
            if before is not None and number != before + 1:
                self._note("header", f"headerId {number} of {name} stands after {before}")
            vehicle.headers[name] = number
        whose = (payload.get("manufacturer"), payload.get("serialNumber"))
        if whose != (parts[2], parts[3]):
            self._note("header", f"it names vehicle {shown(whose)}, its topic another")
        self._version(vehicle, payload["version"], parts[1])
        now = moment_of(payload.get("timestamp"), zoned=True)
        if now is None:
            self._note("time", f"timestamp {shown(payload.get('timestamp'))} is none by ISO 8601 in UTC")
            return
        if payload.get("connectionState") == "CONNECTIONBROKEN":  # told by the broker, as old as the connection
            return
        if now < vehicle.times.get(name, now):
            self._note("time", f"the timestamp of this {name} lies before that of the last")
        vehicle.times[name] = now
        self._first = now if self._first is None else min(self._first, now)
        self._last = max(self._last, now)

    def _version(self, vehicle: _Vehicle, version: str, level: str) -> None:
        """Note a version that is oddly written, or not the topic's, once for a vehicle."""
        wrong = not _VERSION.fullmatch(version), f"v{major_of(version)}" != level
        if any(wrong) and f"{level}/{version}" not in vehicle.versions:
            vehicle.versions.add(f"{level}/{version}")
            what = "is not MAJOR.MINOR.PATCH" if wrong[0] else f"is not that of the topic, {shown(level)}"
            self._note("version", f"{shown(version)} {what}")

    def _quality(self, name: str, entry: Entry) -> None:
        wanted = int(name == "connection")
        if entry.qos is not None and entry.qos != wanted:
            self._note("quality", f"{name} is sent with QoS {entry.qos}, not {wanted}")

    def _connection(self, vehicle: _Vehicle, payload: dict[str, Any]) -> None:
        state, vehicle.connection = payload["connectionState"], payload
        if state != "ONLINE":  # from then on no state is due
            self._due(vehicle, vehicle.times.get("connection", self._last))
            vehicle.said = None
        if vehicle.online and state == "ONLINE":
            self._note("connection", "it is ONLINE once more, and was not gone")
        if not vehicle.online and state != "ONLINE" and payload["headerId"] == 0:
            self._note("connection", f"its first word is {state}")
        vehicle.online = state == "ONLINE"

    def _order(self, vehicle: _Vehicle, payload: dict[str, Any]) -> None:
        for what in vehicle.orders.order(payload):
            self._note("order", what)

    def _state(self, vehicle: _Vehicle, payload: dict[str, Any]) -> None:
        now = vehicle.times.get("state")
        if now is not None:
            self._due(vehicle, now)
            vehicle.said = now
        for what in vehicle.orders.state(payload):
            self._note("state", what)

    def _due(self, vehicle: _Vehicle, now: float) -> None:
        if vehicle.said is not None and now - vehicle.said > _LATEST + 1e-3:
            self._note("time", f"it told no state for {now - vehicle.said:.1f} s")
