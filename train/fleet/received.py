"""What vehicles say, of VDA 5050's `state`, `visualization`, `factsheet` and `connection`, taken in liberally.

Nothing here is trusted: of each message what is there and makes sense is kept, the rest is counted by its reason.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from typing import Any, NamedTuple

from train.fleet.figures import AT_PERSON, AT_ROBOT, AT_SHELF, LOADED
from train.fleet.log import Bad, Entry, moment_of, version_of
from train.fleet.vehicle import CONTACTS
from warehouse_env.errors import WarehouseError, shown

MOST_REPORTS = 5_000_000  # of positions, and of states
_MOST_VEHICLES = 2_000
_MOST_NODES = 5_000  # of an order
_FARTHEST = 1e7  # [m]
_BITS = dict(zip(CONTACTS, (AT_ROBOT, AT_SHELF, AT_PERSON), strict=True))
GONE, ASLEEP = ("OFFLINE", "CONNECTIONBROKEN"), "HIBERNATING"
_CONNECTIONS = ("ONLINE", ASLEEP, *GONE)  # CONNECTION_BROKEN of version 3 counts as CONNECTIONBROKEN
_POSITIONS = ("agvPosition", "mobileRobotPosition")  # until version 2, and from 3 on
_READ = range(1, 4)  # major versions
_PARKING = ("startCharging", "stopCharging")  # actions that are no goal's

Key = tuple[str, str]
"""Manufacturer and serial number."""


class Told(NamedTuple):
    """What a state says beside where the vehicle is."""

    seconds: float
    order: str
    update: int
    left: int  # nodes and edges to come
    nodes: tuple[tuple[float, float], ...]  # to come, of those with a position; none where they are as before
    works: bool  # an action at a node is more than charging
    bits: int  # see figures


class Vehicle:
    """What one vehicle has said."""

    def __init__(self) -> None:
        self.seconds, self.x, self.y, self.theta = array("d"), array("d"), array("d"), array("d")
        self.maps: list[str] = []
        self.map = array("H")
        self.told: list[Told] = []
        self.factsheet: dict[str, Any] = {}
        self.connection: dict[str, Any] = {}  # what it said of it last
        self.connected: list[tuple[float, str]] = []  # moment and state of each connection message
        self._last: tuple[str, int] | None = None
        self._latest = -math.inf  # moment of any message so far

    @property
    def spoke(self) -> bool:
        """Whether it has said anything that it only says while it is there."""
        return bool(self.connection or self.seconds or self.told)

    def connect(self, payload: dict[str, Any], state: str) -> None:
        """Keep a connection message. The broker tells a broken one, with a timestamp from before the connection."""
        moment = moment_of(payload.get("timestamp"))
        if moment is None or state == GONE[1]:
            moment = self._latest
        self._latest = max(self._latest, moment)
        self.connection = payload
        self.connected.append((moment, state))

    def place(self, seconds: float, pose: tuple[float, float, float], name: str) -> None:
        """Keep a position."""
        if name not in self.maps:
            if len(self.maps) == 1000:
                return
            self.maps.append(name)
        self.seconds.append(seconds)
        for values, value in zip((self.x, self.y, self.theta), pose, strict=True):
            values.append(value)
        self.map.append(self.maps.index(name))
        self._latest = max(self._latest, seconds)

    def tell(self, seconds: float, payload: dict[str, Any]) -> None:
        """Keep what a state says of its order, its load and its errors."""
        order, update = _text(payload.get("orderId")), int(_number(payload.get("orderUpdateId")) or 0)
        listed = [payload.get(name) for name in ("nodeStates", "edgeStates")]
        nodes, edges = map(_objects, listed)
        left = len(nodes) + len(edges)
        if not any(isinstance(one, list) for one in listed):  # it does not say what is left
            left = self.told[-1].left if self.told and self.told[-1].order == order else int(order != "")
        new = self._last != (order, update)
        self._last = (order, update)
        positions = tuple(filter(None, (_point(node) for node in nodes[:_MOST_NODES]))) if new else ()
        works = any(one.get("actionType") not in _PARKING for one in _objects(payload.get("actionStates")))
        bits = LOADED if _objects(payload.get("loads")) else 0
        for error in _objects(payload.get("errors")):
            kind = error.get("errorType")
            bits |= _BITS.get(kind, 0) if isinstance(kind, str) else 0
        self.told.append(Told(seconds, order, update, left, positions, works, bits))
        self._latest = max(self._latest, seconds)


class Fleet:
    """All vehicles, and what of their messages was of no use."""

    def __init__(self) -> None:
        self.vehicles: dict[Key, Vehicle] = {}
        self.left_out: Counter[str] = Counter()
        self.versions: Counter[int] = Counter()  # messages read, by major version
        self.named: dict[int, str] = {}  # major version -> as it was first written
        self.messages = self.places = self.states = 0
        self.gaps: list[float] = []  # [s] for which nothing was heard since the connection was broken
        self._said: set[tuple[Key, str]] = set()  # topics of vehicles on which something came

    def add(self, entry: Entry | Bad) -> None:
        """Take in a message; WarehouseError where there are more than can be kept."""
        if isinstance(entry, Bad):
            self.left_out["are no message"] += 1
            return
        if self.is_stale(entry):
            return
        self.messages += 1
        payload = entry.payload
        name = _kind(entry)
        if name in ("order", "instantActions"):  # what states say of it tells more
            return
        key = _key(entry)
        if name is None or key is None:
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
            vehicle.factsheet = vehicle.factsheet or payload
        elif name == "connection":
            state = _connection(payload)
            if state is None:
                self.left_out["have a connectionState that is none"] += 1
            else:
                vehicle.connect(payload, state)
        else:
            self._report(vehicle, name, payload)

    def is_stale(self, entry: Entry) -> bool:
        """Whether a message is what the broker has kept of a vehicle that went away before, or what it said already."""
        if not entry.retain or _kind(entry) != "connection":
            return False
        key = _key(entry)
        vehicle = self.vehicles.get(key) if key is not None else None
        if vehicle is None or not vehicle.spoke:
            return _connection(entry.payload) in GONE
        return vehicle.connection == entry.payload

    @property
    def gone(self) -> bool:
        """Whether all vehicles that spoke have said that they are offline, and there are some."""
        spoke = [vehicle for vehicle in self.vehicles.values() if vehicle.spoke]
        return bool(spoke) and all(one.connected and one.connected[-1][1] in GONE for one in spoke)

    def _is_read(self, entry: Entry) -> bool:
        """Whether a message is of a version that is read, or names none; count it by its version."""
        version, major = version_of(entry)
        if major is None:
            return True
        named = shown(self.named.setdefault(major, version))
        if major not in _READ:
            reads = f"versions {_READ[0]} to {_READ[-1]} are read"
            self.left_out[f"are of version {named} of VDA 5050, and {reads}"] += 1
            return False
        self.versions[major] += 1
        return True

    def _vehicle(self, key: Key) -> Vehicle:
        if key not in self.vehicles:
            if len(self.vehicles) == _MOST_VEHICLES:
                raise WarehouseError(f"there are more than {_MOST_VEHICLES:,} vehicles in these messages")
            self.vehicles[key] = Vehicle()
        return self.vehicles[key]

    def _report(self, vehicle: Vehicle, name: str, payload: dict[str, Any]) -> None:
        """Keep where a vehicle is and what it says, of a state or a visualization."""
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
        pose = pose[0], pose[1], math.remainder(pose[2], math.tau)
        vehicle.place(seconds, pose, _text(position.get("mapId"))[:200])


def _kind(entry: Entry) -> str | None:
    """Return the topic's name of a message; by what it holds where a log does not say."""
    if entry.topic is not None:
        name = entry.topic.rpartition("/")[2]
        return (
            name if name in ("connection", "factsheet", "order", "instantActions", "state", "visualization") else None
        )
    signs = {
        "connectionState": "connection", "typeSpecification": "factsheet", "nodes": "order",
        "actions": "instantActions", "nodeStates": "state", "agvPosition": "visualization",
        "mobileRobotPosition": "visualization",
    }  # fmt: skip
    return next((name for sign, name in signs.items() if entry.payload.get(sign) is not None), None)


def _key(entry: Entry) -> Key | None:
    """Return whose message it is, by its topic, else by its header; a short topic counts where that says nothing."""
    parts = entry.topic.split("/") if entry.topic is not None else []
    header = [_text(entry.payload.get(name)) for name in ("manufacturer", "serialNumber")]
    first, second = parts[-3:-1] if len(parts) >= 5 or (len(parts) == 4 and not header[1]) else header
    return (first, second) if second and len(first) + len(second) < 200 else None


def _connection(payload: dict[str, Any]) -> str | None:
    """Return a connectionState of any version by the name that version 2 has for it; None for what is none."""
    state = _text(payload.get("connectionState")).upper().replace("_", "")
    return state if state in _CONNECTIONS else None


def _pose(position: dict[str, Any]) -> tuple[float, float, float] | None:
    """Return x, y [m] and theta [rad] of a position; None where one is missing, or the vehicle has not found itself."""
    if any(position.get(name) in (False, "false") for name in ("positionInitialized", "localized")):
        return None
    return _numbers(position, ("x", "y", "theta"))  # type: ignore[return-value]


def _objects(value: object) -> list[dict[str, Any]]:
    return [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []


def _numbers(data: dict[str, Any], names: tuple[str, ...]) -> tuple[float, ...] | None:
    """Return numbers that an object has by these names, None unless all are."""
    values = tuple(_number(data.get(name)) for name in names)
    return None if None in values else values  # type: ignore[return-value]


def _number(value: object) -> float | None:
    """Return a number, also one in quotes as some controllers write it; None for what is none."""
    if isinstance(value, str) and len(value) <= 40:
        try:
            value = float(value)
        except ValueError:
            return None
    good = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _FARTHEST
    return float(value) if good else None  # type: ignore[arg-type]


def _text(value: object) -> str:
    """Return a name, also one that is written as a number; none for what is neither."""
    return str(value) if isinstance(value, str | int) and not isinstance(value, bool) else ""


def _point(node: dict[str, Any]) -> tuple[float, float] | None:
    position = node.get("nodePosition")
    found = _numbers(position, ("x", "y")) if isinstance(position, dict) else None
    return None if found is None or not all(map(math.isfinite, found)) else (found[0], found[1])
