"""Lanes as a route graph of nav2_route, a GeoJSON file: read and written.

Points are nodes, with an id; LineStrings, or as written MultiLineStrings of one line, are directed edges, with id,
startid and endid. `metadata` of an edge may hold `abs_speed_limit` [m/s] or `speed_limit` [per cent of the robot's
highest speed]; of a node, its `place`, which is ours.
An edge's `cost` replaces its length [m] in the cost of a route.
"""

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.errors import MapError, shown
from warehouse_env.files import as_number, path_of, read_json, write_text
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.lanes import MOST, Lane, Lanes, of_floor
from warehouse_env.maps.halls.places import KINDS, Place
from warehouse_env.maps.tables import CHEAPEST, DEAREST

SUFFIX = ".geojson"
_LARGEST_FILE = 64_000_000  # [bytes]
_FARTHEST = 1e9  # [m] of a coordinate


def read_route_graph(path: Path) -> Lanes:
    """Return the lanes of a file; MapError in one sentence if it cannot be used.

    Nodes at dead ends are stations, unless nodes name their place.
    """
    data = read_json(path, "route graph", _LARGEST_FILE)
    features = data.get("features") if isinstance(data, dict) else None
    if not isinstance(features, list) or len(features) > 2 * MOST:
        raise MapError(f'{path} is not a route graph: it must hold "features", a list of at most {2 * MOST:,}')
    lanes = Lanes()
    kinds: dict[str, list[Any]] = {"Point": [], "LineString": [], "MultiLineString": []}
    for feature in features:
        geometry = feature.get("geometry") if isinstance(feature, dict) else None
        geometry = geometry if isinstance(geometry, dict) else {}
        kind = geometry.get("type")
        if not isinstance(kind, str) or kind not in kinds:
            lanes.notes["a feature is neither Point nor LineString and is left out"] += 1
        elif not isinstance(feature.get("properties"), dict):
            raise MapError(f"{path}: a {kind} has no properties, in which its id stands")
        else:
            kinds[kind].append((feature["properties"], geometry.get("coordinates")))
    for properties, coordinates in kinds["Point"]:
        _take_node(path, lanes, properties, coordinates)
    if not lanes.nodes:
        raise MapError(f"{path} has no node: no Point with an id")
    edges = [*kinds["LineString"], *kinds["MultiLineString"]]
    known: set[str] = set(lanes.nodes)
    lanes.lanes = [_lane(path, lanes, known, *edge) for edge in edges]
    if not lanes.places:
        _dead_ends(lanes)
    return lanes


def _id(path: Path, properties: dict[str, Any], key: str) -> str:
    value = properties.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, str)) or len(shown(value)) > 70:
        raise MapError(f"{path}: {key} {shown(value)} must be a whole number")
    return str(value)


def _line(path: Path, what: str, coordinates: Any) -> NDArray[np.float64]:
    """Return float64[K, 2] of coordinates, without heights."""
    points = coordinates if isinstance(coordinates, list) else []
    if len(points) == 1 and isinstance(points[0], list) and points[0] and isinstance(points[0][0], list):
        points = points[0]  # MultiLineString of one line
    good = bool(points) and all(
        isinstance(point, list) and len(point) >= 2 and all(abs(as_number(v)) < _FARTHEST for v in point[:2])
        for point in points
    )
    if not good:
        raise MapError(f"{path}: {what} has coordinates {shown(coordinates)}, not [x, y] in metres")
    return np.array([[as_number(v) for v in point[:2]] for point in points])


def _take_node(path: Path, lanes: Lanes, properties: dict[str, Any], coordinates: Any) -> None:
    name = _id(path, properties, "id")
    if name in lanes.nodes:
        raise MapError(f"{path}: id {name} is used by two nodes; give each its own")
    x, y = _line(path, f"node {name}", [coordinates])[0].tolist()
    lanes.nodes[name] = (x, y)
    metadata = properties.get("metadata")
    place = metadata.get("place") if isinstance(metadata, dict) else None
    for kind in KINDS:
        if place == kind[:-1]:
            lanes.places[kind] = (*lanes.places.get(kind, ()), Place(name, x, y))


def _lane(path: Path, lanes: Lanes, known: set[str], properties: dict[str, Any], coordinates: Any) -> Lane:
    name = _id(path, properties, "id")
    if name in known:
        lanes.notes["an id is used more than once; all its uses are kept"] += 1
    known.add(name)
    ends = _id(path, properties, "startid"), _id(path, properties, "endid")
    for end in ends:
        if end not in lanes.nodes:
            raise MapError(f"{path}: edge {name} leads to node {end}, which does not exist")
    line = _line(path, f"edge {name}", coordinates) if coordinates else np.empty((0, 2))
    line = np.concatenate([[lanes.nodes[ends[0]]], line[1:-1], [lanes.nodes[ends[1]]]])  # nodes say where lanes end
    metadata = properties.get("metadata")
    speed = _speed(path, name, metadata if isinstance(metadata, dict) else {})
    return Lane(name, *ends, line, speed, _price(path, lanes, name, properties, line))


def _price(path: Path, lanes: Lanes, name: str, properties: dict[str, Any], line: NDArray[np.float64]) -> float:
    """Return what an edge costs, times its length."""
    cost, length = properties.get("cost"), float(np.hypot(*np.diff(line, axis=0).T).sum())
    if cost is None or (cost == 0 and properties.get("overridable", True)) or length == 0:
        return 1.0  # Nav2 takes a missing cost for 0, and uses the length instead
    if not 0 <= as_number(cost) < math.inf:
        raise MapError(f"{path}: edge {name}: cost {shown(cost)} must be a number of at least 0")
    asked = as_number(cost) / length
    price = min(max(asked, CHEAPEST), DEAREST)
    if price != asked:
        lanes.notes[f"a cost is clipped to {CHEAPEST:g} to {DEAREST:g} times its lane's length"] += 1
    return price


def _speed(path: Path, name: str, metadata: dict[str, Any]) -> float:
    for key, unit in (("abs_speed_limit", 1.0), ("speed_limit", RobotSpec.max_speed / 100)):
        value = metadata.get(key)
        if value is not None:
            if not 0 < as_number(value) < math.inf:
                raise MapError(f"{path}: edge {name}: {key} {shown(value)} must be a number above 0")
            return as_number(value) * unit
    return float(np.inf)


def _dead_ends(lanes: Lanes) -> None:
    near: dict[str, set[str]] = {}
    for lane in lanes.lanes:
        near.setdefault(lane.start, set()).add(lane.end)
        near.setdefault(lane.end, set()).add(lane.start)
    ends = tuple(Place(name, *lanes.nodes[name]) for name, others in near.items() if len(others - {name}) == 1)
    if ends:
        lanes.places[KINDS[1]] = ends


def write_route_graph(grid: GridMap, path: str | os.PathLike[str]) -> None:
    """Write a floor's lanes with all their rules, picks and stations as a route graph, whole or not at all."""
    lanes = of_floor(grid)
    number = {name: k for k, name in enumerate(lanes.nodes)}
    place = {one.name: kind[:-1] for kind in KINDS for one in lanes.places[kind]}
    features = [
        _feature({"id": number[name]} | ({"metadata": {"place": place[name]}} if name in place else {}), "Point", where)
        for name, where in lanes.nodes.items()
    ]
    for k, lane in enumerate(lanes.lanes, start=len(number)):
        about: dict[str, Any] = {"id": k, "startid": number[lane.start], "endid": number[lane.end]}
        if np.isfinite(lane.speed):
            about["metadata"] = {"abs_speed_limit": lane.speed}
        if lane.price != 1.0:
            about |= {"cost": lane.price * float(np.hypot(*(lane.line[1] - lane.line[0]))), "overridable": False}
        features.append(_feature(about, "MultiLineString", [lane.line.tolist()]))
    data = {"type": "FeatureCollection", "name": grid.name, "features": features}
    write_text(path_of(path, MapError), json.dumps(data, indent=1) + "\n")


def _feature(properties: dict[str, Any], kind: str, coordinates: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}
