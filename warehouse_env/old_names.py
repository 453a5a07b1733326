"""Names of older versions: options in stored configurations, policies and trainers, and what they are called today."""

from typing import Any

from warehouse_env.errors import ConfigError, shown

POLICIES = {"threaded_ppo": "shielded"}
ALGORITHMS = {"threaded_ppo": "ppo (ours)", "ppo": "ppo (stable-baselines3)", "reinforce": "reinforce (ours)"}

_TRAFFIC = {
    "protective_field": "shield", "field_margin": "margin", "right_of_way": "right_of_way",
    "right_of_way_after": "right_of_way_after", "reroute": "routes",
}  # fmt: skip
_REAL = {
    "message_latency": "latency", "pose_error": "pose_error", "heading_error": "heading_error",
    "actuation_error": "actuation_error", "message_loss": "loss", "message_burst": "burst",
}  # fmt: skip
_BOUNDS = ("latency", "pose_error", "heading_error", "actuation_error")
_NEW = {**dict.fromkeys((*_TRAFFIC, "reroute_spec"), "traffic"), **dict.fromkeys((*_REAL, "field_spec"), "uncertainty")}


def by_todays_names(data: dict[str, Any]) -> dict[str, Any]:
    """Return an EnvConfig's stored fields under today's names; ConfigError if old and new names are mixed."""
    given = {name: value for name, value in data.items() if name not in _NEW and name != "map_file"}
    for name in data:
        if _NEW.get(name) in given:
            raise ConfigError(f"{name!r} is an old name of what {_NEW[name]!r} says: leave one of them out")
    if data.get("map_file") is not None:
        given["layout"] = data["map_file"]
    field, routes = dict(_part(data, "field_spec")), dict(_part(data, "reroute_spec"))
    for name in ("scanner_rays", "unseen_speed"):
        field.pop(name, None)
    if any(_NEW.get(name) == "traffic" for name in data):
        traffic = {new: data[old] for old, new in _TRAFFIC.items() if old in data}
        if routes.pop("only_barred", False) is True and traffic.get("routes") is True:
            traffic["routes"] = "barred"
        if routes.get("planner") == data.get("planner"):
            routes.pop("planner", None)
        # features that were off had no effect
        given["traffic"] = traffic | (routes if traffic.get("routes") else {})
    if any(_NEW.get(name) == "uncertainty" for name in data):
        real = {new: data[old] for old, new in _REAL.items() if old in data}
        same = all(real.get(name, 0.0) == field.get(name, 0.0) for name in _BOUNDS) and set(field) <= set(_BOUNDS)
        given["uncertainty"] = real | {"declared": None if same else field}
    return given


def _part(data: dict[str, Any], name: str) -> dict[str, Any]:
    part = data.get(name, {})
    if not isinstance(part, dict):
        raise ConfigError(f"{name} must be an object of names and values, not {shown(part)}")
    return part
