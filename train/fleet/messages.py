"""VDA 5050 messages: topics, headers, quality of service, factsheets, and logs as `mosquitto_sub -F %J` prints."""

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from train.fleet.version3 import as_version_3
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import shown
from warehouse_env.files import complete_file, path_of, text_lines
from warehouse_env.format_version import major_of

VERSIONS = {2: "2.1.0", 3: "3.0.0"}
"""Versions of VDA 5050 that are written and checked, by their major numbers."""
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
    major: int = 2  # of the version that is written

    def topic(self, serial: str, name: str) -> str:
        """Return the full name of a vehicle's topic."""
        return f"{self.interface}/v{self.major}/{self.manufacturer}/{serial}/{name}"

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
        told = header | self._worded(name, body)
        return Message(seconds, self._names.topic(self._serial, name), told, int(lasting), lasting)

    def _worded(self, name: str, body: dict[str, Any]) -> dict[str, Any]:
        """Return the body of a message as the version has it."""
        return body if self._names.major == 2 else as_version_3(name, body, self._sent["state"] - 1)

    def header(self, seconds: float, number: int) -> dict[str, Any]:
        """Return the header of a topic's message with this number, counted from 0."""
        return {
            "headerId": number, "timestamp": self._names.stamp(seconds), "version": VERSIONS[self._names.major],
            "manufacturer": self._names.manufacturer, "serialNumber": self._serial,
        }  # fmt: skip

    def last_will(self) -> Message:
        """Return what the broker publishes if the vehicle is cut off after its first connection message."""
        payload = self.header(0.0, 1) | self._worded("connection", {"connectionState": "CONNECTIONBROKEN"})
        return Message(0.0, self._names.topic(self._serial, "connection"), payload, 1, True)


def write_log(messages: Iterable[Message], folder: Path) -> int:
    """Write messages to FOLDER/messages.jsonl, completely or not at all; return their number."""
    count = 0
    with complete_file(folder / LOG) as part, part.open("w", encoding="utf-8") as file:
        for message in messages:
            file.write(message.line)
            count += 1
    return count


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
    for number, line in text_lines(path, "log of messages", _LARGEST_FILE, LONGEST):
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


def factsheet_of(config: EnvConfig, every: float) -> dict[str, Any]:
    """Return the factsheet of a config's robots; every: seconds between two reports.

    The actions have no blockingTypes, since the official schema accepts no list of them.
    """
    robot = config.robot
    return {
        "typeSpecification": {
            "seriesName": "warehouse_env", "seriesDescription": "simulated; the position is that of the fixed axle",
            "agvKinematic": "THREEWHEEL", "agvClass": "CARRIER", "maxLoadMass": robot.payload,
            "localizationTypes": ["NATURAL"], "navigationTypes": ["AUTONOMOUS"],
        },
        "physicalParameters": {
            "speedMin": 0.0, "speedMax": robot.max_speed,
            "accelerationMax": robot.max_acceleration, "decelerationMax": robot.max_acceleration,
            "heightMin": robot.height, "heightMax": robot.height, "width": robot.width, "length": robot.length,
        },
        "protocolLimits": {
            "maxStringLens": {}, "maxArrayLens": {},
            "timing": {"minOrderInterval": every, "minStateInterval": every, "visualizationInterval": every},
        },
        "protocolFeatures": {"optionalParameters": [], "agvActions": [
            {"actionType": kind, "actionScopes": ["NODE"]} for kind in ("pick", "drop")]},
        "agvGeometry": {"envelopes2d": [_envelope(robot)]},
        "loadSpecification": {"loadSets": [{"setName": "goods", "loadType": "goods", "maxWeight": robot.payload}]},
    }  # fmt: skip


def _envelope(robot: RobotSpec) -> dict[str, Any]:
    """Return the outline of the body around its position."""
    ahead, back, half = robot.front_overhang, -robot.rear_reach, robot.width / 2
    corners = [(ahead, half), (back, half), (back, -half), (ahead, -half)]
    return {"set": "body", "polygonPoints": [{"x": round(x, 4), "y": round(y, 4)} for x, y in corners]}


def body_of(factsheet: dict[str, Any]) -> tuple[dict[str, float], str]:
    """Return the fields of RobotSpec that a factsheet gives, and their source.

    An outline (envelopes2d) places the position in the body; without one it is the middle.
    """
    found = _outline(factsheet)
    if found is not None:
        west, east, south, north = found
        size = {"length": round(east - west, 6), "width": round(north - south, 6)}
        return {**size, "front_overhang": east}, "the outline in its factsheet"
    parameters = factsheet.get("physicalParameters")
    sizes = [parameters.get(name) if isinstance(parameters, dict) else None for name in ("length", "width")]
    length, width = (_size(size) for size in sizes)
    if length is None or width is None:
        return {}, "no factsheet: a body as simulated robots have it"
    body = {"length": length, "width": width, "front_overhang": length / 2}
    return body, "length and width in its factsheet, the position in the middle"


def _outline(factsheet: dict[str, Any]) -> tuple[float, float, float, float] | None:
    """Return the bounds (west, east, south, north) [m] of the first outline around the position, or None."""
    for geometry, outline in (("mobileRobotGeometry", "vertices"), ("agvGeometry", "polygonPoints")):  # versions 3, 2
        try:
            points = factsheet[geometry]["envelopes2d"][0][outline]
            xs, ys = ([float(point[axis]) for point in points] for axis in ("x", "y"))
            found = min(xs), max(xs), min(ys), max(ys)
        except (KeyError, IndexError, TypeError, ValueError, OverflowError):
            continue
        if all(map(math.isfinite, found)) and found[0] < 0 <= found[1] and found[2] < found[3]:
            return found
    return None


def _size(value: object) -> float | None:
    good = isinstance(value, int | float) and not isinstance(value, bool) and 0.01 <= value <= 100.0
    return float(value) if good else None  # type: ignore[arg-type]
