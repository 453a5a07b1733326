"""Write the factsheet of simulated robots, and read a vehicle's body from any factsheet."""

from __future__ import annotations

import math
from typing import Any

from warehouse_env.config import EnvConfig, RobotSpec


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
