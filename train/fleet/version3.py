"""Messages of VDA 5050 2.1.0 as version 3.0.0 writes them."""

from typing import Any

_NAMES = {
    "agvActions": "mobileRobotActions", "agvClass": "mobileRobotClass", "agvGeometry": "mobileRobotGeometry",
    "agvKinematic": "mobileRobotKinematics", "agvPosition": "mobileRobotPosition", "positionInitialized": "localized",
    "batteryState": "powerSupply", "batteryCharge": "stateOfCharge", "eStop": "activeEmergencyStop",
    "nodeDescription": "nodeDescriptor", "set": "envelope2dId", "polygonPoints": "vertices",
    "accelerationMax": "maximumAcceleration", "decelerationMax": "maximumDeceleration",
    "heightMax": "maximumHeight", "heightMin": "minimumHeight", "speedMax": "maximumSpeed", "speedMin": "minimumSpeed",
    "maxSpeed": "maximumSpeed", "maxLoadMass": "maximumLoadMass", "maxWeight": "maximumWeight",
    "maxArrayLens": "maximumArrayLengths", "maxStringLens": "maximumStringLengths",
    "minOrderInterval": "minimumOrderInterval", "minStateInterval": "minimumStateInterval",
}  # fmt: skip
_VALUES = {
    "AUTONOMOUS": "FREELY_NAVIGATING", "CONNECTIONBROKEN": "CONNECTION_BROKEN", "THREEWHEEL": "THREE_WHEEL",
}  # fmt: skip
_GONE = ("startNodeId", "endNodeId")  # the sequence ids say which nodes an edge joins
_ACTION = {"pauseAllowed": False, "cancelAllowed": False}


def as_version_3(topic: str, body: dict[str, Any], state: int) -> dict[str, Any]:
    """Return a topic's message without its header; state: headerId of the vehicle's last state."""
    told: dict[str, Any] = _renamed(body)
    if topic == "state":
        told["instantActionStates"] = []
    if topic == "visualization":
        told["referenceStateHeaderId"] = state
    if topic == "factsheet":
        features = told["protocolFeatures"]
        features["mobileRobotActions"] = [action | _ACTION for action in features["mobileRobotActions"]]
    return told


def _renamed(value: Any) -> Any:
    if isinstance(value, list):
        return [_renamed(one) for one in value]
    if not isinstance(value, dict):
        return _VALUES.get(value, value) if isinstance(value, str) else value
    told = {_NAMES.get(name, name): _renamed(one) for name, one in value.items() if name not in _GONE}
    if "allowedDeviationXY" in told:  # an ellipse
        told["allowedDeviationXY"] = {"a": value["allowedDeviationXY"], "b": value["allowedDeviationXY"], "theta": 0.0}
    return told
