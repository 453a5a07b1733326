"""Read `state`, `visualization`, `factsheet` and `connection` messages of any vehicle, leniently.

The usable parts of each message are kept; the rest is counted by its reason.
"""

import math
from array import array
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.fleet.figures import AT_PERSON, AT_ROBOT, AT_SHELF, LOADED
from train.fleet.messages import Bad, LogEntry, log_path, moment_of, read_log, version_of
from train.fleet.vehicle import CONTACTS
from warehouse_env.errors import WarehouseError

MOST_REPORTS = 5_000_000  # positions, and states
_MOST_VEHICLES = 2_000
_MOST_MAPS = 1_000  # of a vehicle
_MOST_NODES = 5_000  # of an order
_FARTHEST = 1e7  # [m]
_BITS = dict(zip(CONTACTS, (AT_ROBOT, AT_SHELF, AT_PERSON), strict=True))
GONE = ("OFFLINE", "CONNECTIONBROKEN")  # version 3 writes CONNECTION_BROKEN
_CONNECTIONS = ("ONLINE", *GONE)
_POSITIONS = ("agvPosition", "mobileRobotPosition")  # until version 2, and from 3 on
_IGNORED = ("order", "instantActions")  # states hold more about them
_READ = range(1, 4)  # major versions
_PARKING = ("startCharging", "stopCharging")  # actions that are no goal's

Key = tuple[str, str]
"""Manufacturer and serial number."""


class Told(NamedTuple):
    """A state without its position."""

    seconds: float
    order: str
    left: int  # nodes and edges to come
    nodes: tuple[tuple[float, float], ...]  # to come, those with a position; empty if unchanged
    works: bool  # an action at a node is more than charging
    bits: int  # see figures


class HeardVehicle:
    """The messages of one vehicle."""

    def __init__(self) -> None:
        self._reports = array("d")
        self.maps: dict[str, int] = {}  # their numbers in reports
        self.told: list[Told] = []
        self.factsheet: dict[str, Any] = {}
        self.connection: dict[str, Any] = {}  # the last message
        self.connected: list[tuple[float, str]] = []  # moment and state of each connection message
        self._last: tuple[str, object] | None = None
        self._latest = -math.inf  # moment of any message so far

    @property
    def reports(self) -> NDArray[np.float64]:
        """Return float64[K, 5]: the time [s] since 1970, x, y [m], heading [rad] and map of each position, as heard."""
        return np.array(self._reports).reshape(-1, 5)

    @property
    def spoke(self) -> bool:
        """Whether it has sent a message that only a present vehicle sends."""
        return bool(self.connection or self._reports or self.told)

    def connect(self, payload: dict[str, Any], state: str) -> None:
        """Keep a connection message. A broken connection is reported with a timestamp from before the connection."""
        moment = moment_of(payload.get("timestamp"))
        if moment is None or state == GONE[1]:
            moment = self._latest
        self._latest = max(self._latest, moment)
        self.connection = payload
        self.connected.append((moment, state))

    def place(self, seconds: float, pose: tuple[float, float, float], name: str) -> None:
        """Keep a position; those on more than _MOST_MAPS maps are dropped."""
        if name in self.maps or len(self.maps) < _MOST_MAPS:
            self._reports.extend((seconds, *pose, self.maps.setdefault(name, len(self.maps))))
            self._latest = max(self._latest, seconds)

    def tell(self, seconds: float, payload: dict[str, Any]) -> None:
        """Keep the order, load and errors of a state."""
        order = _text(payload.get("orderId"))
        listed = [payload.get(name) for name in ("nodeStates", "edgeStates")]
        nodes, edges = map(_objects, listed)
        left = len(nodes) + len(edges)
        if not any(isinstance(one, list) for one in listed):  # it does not list what is left
            left = self.told[-1].left if self.told and self.told[-1].order == order else int(order != "")
        new = self._last != (order, payload.get("orderUpdateId"))
        self._last = (order, payload.get("orderUpdateId"))
        positions = tuple(filter(None, (_point(node) for node in nodes[:_MOST_NODES]))) if new else ()
        works = any(one.get("actionType") not in _PARKING for one in _objects(payload.get("actionStates")))
        bits = LOADED if _objects(payload.get("loads")) else 0
        for error in _objects(payload.get("errors")):
            bits |= _BITS.get(_text(error.get("errorType")), 0)
        self.told.append(Told(seconds, order, left, positions, works, bits))
        self._latest = max(self._latest, seconds)


class HeardFleet:
    """All vehicles, and counts of unused messages."""

    def __init__(self) -> None:
        self.vehicles: dict[Key, HeardVehicle] = {}
        self.left_out: Counter[str] = Counter()
        self.versions: Counter[int] = Counter()  # messages read, by major version
        self.messages = self.places = self.states = 0
        self._said: set[tuple[Key, str]] = set()  # vehicles and topics heard so far

    def add(self, entry: LogEntry | Bad) -> None:
        """Take a message; WarehouseError if there are too many to keep."""
        if isinstance(entry, Bad):
            self.left_out["are no message"] += 1
            return
        if self._is_stale(entry):
            return
        self.messages += 1
        name, key = entry.topic.rpartition("/")[2], _key(entry)
        if name in _IGNORED:
            return
        if name not in ("connection", "factsheet", "state", "visualization") or key is None:
            self.left_out["are of no topic or vehicle of VDA 5050"] += 1
            return
        if not self._is_read(entry):
            return
        first = (key, name) not in self._said
        self._said.add((key, name))
        if first and entry.retain and name in ("state", "visualization"):
            self.left_out["are of a time before, kept by the broker"] += 1
            return
        vehicle = self._vehicle(key)
        if name == "factsheet":
            vehicle.factsheet = vehicle.factsheet or entry.payload
        elif name == "connection":
            state = _connection(entry.payload)
            if state is None:
                self.left_out["have another connectionState"] += 1
            else:
                vehicle.connect(entry.payload, state)
        else:
            self._report(vehicle, name, entry.payload)

    def _is_stale(self, entry: LogEntry) -> bool:
        """Return whether a connection message is retained from an earlier session, or repeated."""
        if not entry.retain or not entry.topic.endswith("/connection"):
            return False
        key = _key(entry)
        vehicle = self.vehicles.get(key) if key is not None else None
        if vehicle is None or not vehicle.spoke:
            return _connection(entry.payload) in GONE
        return vehicle.connection == entry.payload

    def _is_read(self, entry: LogEntry) -> bool:
        """Return whether a message names a version that is read, or none; count it by its version."""
        _, major = version_of(entry)
        if major is None:
            return True
        if major not in _READ:
            self.left_out[f"are of version {major} of VDA 5050 (versions {_READ[0]} to {_READ[-1]} are read)"] += 1
            return False
        self.versions[major] += 1
        return True

    def _vehicle(self, key: Key) -> HeardVehicle:
        if key not in self.vehicles:
            if len(self.vehicles) == _MOST_VEHICLES:
                raise WarehouseError(f"there are more than {_MOST_VEHICLES:,} vehicles in these messages")
            self.vehicles[key] = HeardVehicle()
        return self.vehicles[key]

    def _report(self, vehicle: HeardVehicle, name: str, payload: dict[str, Any]) -> None:
        """Keep the position, and the rest of a state."""
        seconds = moment_of(payload.get("timestamp"))
        if seconds is None:
            self.left_out["have no timestamp"] += 1
            return
        if self.places >= MOST_REPORTS or self.states >= MOST_REPORTS:
            raise WarehouseError(f"there are more than {MOST_REPORTS:,} positions in these messages; cut the log")
        if name == "state":
            self.states += 1
            vehicle.tell(seconds, payload)
        given = [payload[key] for key in _POSITIONS if payload.get(key) is not None]
        if not given and name == "state":
            return
        pose, position = next(((pose, one) for one in _objects(given) if (pose := _pose(one)) is not None), (None, {}))
        if pose is None:
            self.left_out["have no position"] += 1
            return
        self.places += 1
        vehicle.place(seconds, pose, _text(position.get("mapId"))[:200])


def hear_log(given: Path, moved: Callable[[], object] = lambda: None) -> HeardFleet:
    """Read a log file, or the one in a folder; moved: called after each line. WarehouseError if there is none."""
    fleet = HeardFleet()
    for _, entry in read_log(log_path(given)):
        fleet.add(entry)
        moved()
    return fleet


def _key(entry: LogEntry) -> Key | None:
    """Return the vehicle of a message, by its topic, or by its header if the topic is short."""
    parts = entry.topic.split("/")
    header = [_text(entry.payload.get(name)) for name in ("manufacturer", "serialNumber")]
    first, second = parts[-3:-1] if len(parts) >= 5 else header
    return (first, second) if second and len(first) + len(second) < 200 else None


def _connection(payload: dict[str, Any]) -> str | None:
    """Return the connectionState as version 2 writes it, None for another one."""
    state = _text(payload.get("connectionState")).upper().replace("_", "")
    return state if state in _CONNECTIONS else None


def _pose(position: dict[str, Any]) -> tuple[float, float, float] | None:
    """Return x, y [m] and theta [rad]; None if one is missing, or the vehicle is not localized."""
    x, y, theta = (_number(position.get(name)) for name in ("x", "y", "theta"))
    lost = position.get("positionInitialized") is False or position.get("localized") is False
    if lost or x is None or y is None or theta is None:
        return None
    return x, y, math.remainder(theta, math.tau)


def _point(node: dict[str, Any]) -> tuple[float, float] | None:
    """Return the position of a node."""
    position = node.get("nodePosition")
    x, y = (_number(position.get(name)) for name in ("x", "y")) if isinstance(position, dict) else (None, None)
    return None if x is None or y is None else (x, y)


def _objects(value: object) -> list[dict[str, Any]]:
    return [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []


def _number(value: object) -> float | None:
    good = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _FARTHEST
    return float(value) if good else None  # type: ignore[arg-type]


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""
