"""Lanes in the Layout Interchange Format, LIF 1.0.0 (VDMA, 2024): read liberally, written as its schema asks.

Its drafts (0.11.0, as in its own examples) are read, too; version 2 has other names and is refused. A node or edge
without an entry for a type of vehicle is closed to that type; a trajectory is a NURBS.
"""

import json
import math
import os
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import MapError, shown
from warehouse_env.files import as_number, path_of, read_json, write_text
from warehouse_env.format_version import major_of
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.lanes import MOST, Lane, Lanes, of_floor
from warehouse_env.maps.halls.places import KINDS, Place

SUFFIX = ".lif.json"
VERSION = "1.0.0"
VEHICLE = "robot"  # type of what is written
_LISTS = ("nodes", "edges", "stations")
_LARGEST_FILE = 64_000_000  # [bytes]
_MOST_POINTS = 1000  # of a trajectory
_FAR = 1.0  # [m] from its nodes up to which a trajectory is joined to them
_FARTHEST = 1e300  # [m] of a coordinate
_NEAR, _TURNED = 0.1, 0.02  # [m] and [rad] up to which two lengths, places or headings agree


def read_lif(path: Path, vehicle: str | None = None) -> Lanes:
    """Return the lanes of a file on the level of its first layout; only those open to `vehicle`, if given.

    MapError in one sentence if it cannot be used; deviations from the format are noted.
    """
    data = read_json(path, "LIF file", _LARGEST_FILE)
    if not isinstance(data, dict) or not isinstance(data.get("layouts"), list) or not data["layouts"]:
        raise MapError(f'{path} is not a LIF file: it must hold "layouts", a list of one or more')
    reading = _Reading(path, vehicle)
    reading.check_version(data.get("metaInformation"))
    return reading.layouts(data["layouts"])


class _Reading:
    """Read one file."""

    def __init__(self, path: Path, vehicle: str | None) -> None:
        self._path, self._vehicle, self._lanes = path, vehicle, Lanes()
        self._actions: dict[str, set[str]] = {}  # node -> types of its actions
        self._elsewhere: set[str] = set()  # nodes of other levels
        self._given: set[tuple[str, str]] = set()  # kind of an id, and its value
        self._layout = ""  # that is being read

    def check_version(self, about: Any) -> None:
        """Raise MapError for a version that is not read; note a missing one."""
        version = about.get("lifVersion") if isinstance(about, dict) else None
        major = major_of(version)
        if major is None:
            self._note(f"lifVersion is missing or unreadable; the file is read as {VERSION}")
        elif major > 1:
            raise self._bad(f"lifVersion {shown(version)} is not read; versions 0 and 1 are")

    def layouts(self, layouts: list[Any]) -> Lanes:
        """Return the lanes of the level of the first layout."""
        for layout in layouts:
            self._object(layout, "layout")
        level = layouts[0].get("layoutLevelId")
        chosen = [layout for layout in layouts if layout.get("layoutLevelId") == level]
        for layout in (layout for layout in layouts if layout.get("layoutLevelId") != level):
            self._note(f"a layout of another level than {shown(level)} is left out")
            self._elsewhere |= {self._own_id(node, "nodeId") for node in self._each(layout, "nodes")}
        for key, take in zip(_LISTS, (self._node, self._edge, self._station), strict=True):
            for layout in chosen:
                self._layout = str(layout.get("layoutId") or "")[:80]
                for entry in self._each(layout, key):
                    take(entry)
        for_whom = "a vehicle" if self._vehicle is None else f"vehicle {shown(self._vehicle)}"
        if not self._lanes.nodes:
            raise self._bad(f"none of its {len(self._actions):,} nodes is open to {for_whom}, so it has no node")
        edges = sum(len(self._list(layout, "edges")) for layout in chosen)
        if edges and not self._lanes.lanes:
            self._note(f"none of its {edges:,} edges is open to {for_whom}")
        return self._lanes

    def _note(self, text: str) -> None:
        self._lanes.notes[text] += 1

    def _bad(self, text: str) -> MapError:
        return MapError(f"{self._path}: {text}")

    def _object(self, entry: Any, what: str) -> None:
        if not isinstance(entry, dict):
            raise self._bad(f"a {what} is {shown(entry)}, not an object of names and values")

    def _list(self, owner: dict[str, Any], key: str) -> list[Any]:
        if owner.get(key) is None:
            return []
        if not isinstance(owner[key], list) or len(owner[key]) > MOST:
            raise self._bad(f"{key} must be a list of at most {MOST:,}")
        return list(owner[key])

    def _each(self, layout: dict[str, Any], key: str) -> Iterator[dict[str, Any]]:
        for entry in self._list(layout, key):
            self._object(entry, key[:-1])
            yield entry

    def _id(self, name: Any, key: str) -> str:
        name = str(name) if math.isfinite(as_number(name)) else name
        if not isinstance(name, str) or not 1 <= len(name) <= 1000:
            raise self._bad(f"{key} {shown(name)} must be a text")
        return name

    def _own_id(self, entry: dict[str, Any], key: str) -> str:
        """Return the id of an entry; MapError if another entry of its kind has the same."""
        name = self._id(entry.get(key), key)
        if (key, name) in self._given:
            raise self._bad(f"{key} {shown(name)} is used by two {key[:-2]}s; give each its own")
        self._given.add((key, name))
        return name

    def _number(self, value: Any, what: str, default: float = math.nan) -> float:
        number = default if value is None else as_number(value)
        if not abs(number) < _FARTHEST:
            raise self._bad(f"{what} {shown(value)} must be a finite number")
        return number

    def _point(self, where: Any, what: str) -> tuple[float, float]:
        self._object(where, f"position of {what}")
        return self._number(where.get("x"), f"{what}: x"), self._number(where.get("y"), f"{what}: y")

    def _for_us(self, entry: dict[str, Any], key: str) -> dict[str, Any] | None:
        """Return the first entry for our vehicle, or for any; None if the node or edge is closed to it."""
        listed = [one for one in self._list(entry, key) if isinstance(one, dict)]
        return next((one for one in listed if self._vehicle in (None, one.get("vehicleTypeId"))), None)

    def _node(self, entry: dict[str, Any]) -> None:
        name = self._own_id(entry, "nodeId")
        where = self._point(entry.get("nodePosition"), f"node {shown(name)}")
        ours = self._for_us(entry, "vehicleTypeNodeProperties")
        actions = ours.get("actions") if ours else None
        listed = actions if isinstance(actions, list) else []
        self._actions[name] = {str(one.get("actionType")).lower() for one in listed if isinstance(one, dict)}
        self._check_headings(entry, name)
        if ours is not None:
            self._lanes.nodes[name] = where

    def _check_headings(self, entry: dict[str, Any], name: str) -> None:
        """Note a vehicle type that has two headings at a node."""
        known: dict[str, float] = {}
        for one in self._list(entry, "vehicleTypeNodeProperties"):
            theta = as_number(one.get("theta")) if isinstance(one, dict) else math.nan
            if not math.isfinite(theta):
                continue
            kind = str(one.get("vehicleTypeId"))[:80]
            other = known.setdefault(kind, theta)
            if abs(math.remainder(theta - other, math.tau)) > _TURNED:
                node = f"node {shown(name)} of layout {shown(self._layout)}"
                sentence = f"{node}: vehicle {shown(kind)} has headings of {other:g} and {theta:g} rad"
                self._lanes.fault("nodes at which a vehicle has two headings", sentence)

    def _edge(self, entry: dict[str, Any]) -> None:
        name = self._own_id(entry, "edgeId")
        ends = self._known(entry.get("startNodeId"), name), self._known(entry.get("endNodeId"), name)
        ours = self._for_us(entry, "vehicleTypeEdgeProperties")
        if ours is None or not all(end in self._lanes.nodes for end in ends):
            return
        straight = np.array([self._lanes.nodes[end] for end in ends])
        line, speed = self._course(ours.get("trajectory"), name, straight), np.inf
        if ours.get("maxSpeed") is not None:
            speed = self._number(ours["maxSpeed"], f"edge {shown(name)}: maxSpeed")
            if speed <= 0:
                raise self._bad(f"edge {shown(name)}: maxSpeed {speed:g} must be above 0")
        lane = Lane(name, *ends, line, speed, layout=self._layout)
        self._lanes.lanes.append(lane)
        self._check_length(lane, as_number(entry.get("length", ours.get("length"))))

    def _check_length(self, lane: Lane, given: float) -> None:
        """Note a length [m] that is not the lane's. LIF has no lengths, but VDA 5050 has, so files may."""
        course = float(np.hypot(*np.diff(lane.line, axis=0).T).sum())
        if abs(given - course) > _NEAR:
            rather = f"its nodes are {course:.2f} m apart" if len(lane.line) == 2 else f"its course is {course:.2f} m"
            self._lanes.fault("edges with a wrong length", f"{lane.label}: its length is {given:g} m, but {rather}")

    def _known(self, node: Any, owner: str) -> str:
        """Return the id of a node that an edge or a station names."""
        name = self._id(node, "node")
        if name not in self._actions and name not in self._elsewhere:
            raise self._bad(f"{shown(owner)} names node {shown(name)}, which does not exist")
        return name

    def _course(self, trajectory: Any, name: str, straight: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return float64[K, 2], the points of an edge's course; a straight line if it has no sound trajectory."""
        if trajectory is None:
            return straight
        self._object(trajectory, f"trajectory of edge {shown(name)}")
        what = f"edge {shown(name)}: "
        points, knots = (self._list(trajectory, key)[: _MOST_POINTS + 20] for key in ("controlPoints", "knotVector"))
        places = np.array([self._point(point, what + "controlPoint") for point in points]).reshape(-1, 2)
        weights = np.array([self._number(point.get("weight"), what + "weight", 1.0) for point in points])
        knot = np.array([self._number(value, what + "knotVector") for value in knots])
        degree = self._number(trajectory.get("degree"), what + "degree", 1.0)
        sound = 2 <= len(places) <= _MOST_POINTS and degree in (1, 2, 3, 4, 5) and (weights > 0).all()
        sound = sound and len(knot) == len(places) + degree + 1 and (np.diff(knot) >= 0).all()
        sound = sound and knot[int(degree)] < knot[len(places)] and np.abs(places).max() <= 1e9
        curve = _nurbs(places, weights, knot, int(degree)) if sound else np.full((1, 2), np.nan)
        off = np.hypot(*(curve[[0, -1]] - straight).T).max()
        if not off <= _FAR or not np.isfinite(curve).all():
            self._note("a trajectory is no NURBS between its nodes; the lane is straight")
            return straight
        if off > _NEAR:
            label = Lane(name, "", "", straight, layout=self._layout).label
            sentence = f"{label}: its trajectory ends {off:.2f} m from its node; the two are joined"
            self._lanes.fault("trajectories beside their nodes", sentence)
        return np.concatenate([straight[:1], curve, straight[1:]])

    def _station(self, entry: dict[str, Any]) -> None:
        name = self._own_id(entry, "stationId")
        for given in self._list(entry, "interactionNodeIds"):
            node = self._known(given, name)
            if node not in self._lanes.nodes:
                continue
            kind = KINDS[0] if self._actions[node] == {"pick"} else KINDS[1]
            known = self._lanes.places.get(kind, ())
            own = name if all(place.name != name for place in known) else f"{name} {node}"
            self._lanes.places[kind] = (*known, Place(own, *self._lanes.nodes[node]))


def _nurbs(
    points: NDArray[np.float64], weights: NDArray[np.float64], knots: NDArray[np.float64], degree: int
) -> NDArray[np.float64]:
    """Return points on a NURBS curve, float64[K, 2] (Piegl and Tiller, "The NURBS Book", 1997)."""
    from scipy.interpolate import BSpline  # imported late: it takes long

    at = np.linspace(knots[degree], knots[len(points)], 8 * len(points) + 1)
    with np.errstate(all="ignore"):
        curve = BSpline(knots, np.column_stack([points * weights[:, None], weights]), degree)(at)
        return np.asarray(curve[:, :2] / curve[:, 2:])


def write_lif(grid: GridMap, path: str | os.PathLike[str]) -> None:
    """Write a floor's lanes, one-way rules, speed limits, picks and stations as LIF, whole or not at all.

    LIF has no prices of lanes.
    """
    lanes = of_floor(grid)
    words = zip(KINDS, ("pick", "drop"), strict=True)
    action = {place.name: word for kind, word in words for place in lanes.places[kind]}
    stamp = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.00Z")
    data = {
        "metaInformation": {
            "projectIdentification": grid.name, "creator": "warehouse_env", "exportTimestamp": stamp,
            "lifVersion": VERSION,
        },
        "layouts": [{
            "layoutId": grid.name, "layoutVersion": "1",
            "nodes": [_node(name, where, action.get(name)) for name, where in lanes.nodes.items()],
            "edges": [_edge(lane) for lane in lanes.lanes],
            "stations": [
                {"stationId": f"{kind[:-1]} {k}", "interactionNodeIds": [place.name]}
                for kind in KINDS for k, place in enumerate(lanes.places[kind], start=1)
            ],
        }],
    }  # fmt: skip
    write_text(path_of(path, MapError), json.dumps(data, indent=1) + "\n")


def _node(name: str, where: tuple[float, float], action: str | None) -> dict[str, Any]:
    ours: dict[str, Any] = {"vehicleTypeId": VEHICLE}
    if action:
        ours["actions"] = [{"actionType": action, "requirementType": "CONDITIONAL", "blockingType": "HARD"}]
    return {"nodeId": name, "nodePosition": {"x": where[0], "y": where[1]}, "vehicleTypeNodeProperties": [ours]}


def _edge(lane: Lane) -> dict[str, Any]:
    ours: dict[str, Any] = {"vehicleTypeId": VEHICLE, "rotationAllowed": True}
    if np.isfinite(lane.speed):
        ours["maxSpeed"] = lane.speed
    return {"edgeId": lane.name, "startNodeId": lane.start, "endNodeId": lane.end, "vehicleTypeEdgeProperties": [ours]}
