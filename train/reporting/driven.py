"""What policies are driven with, from the configuration in each row: traffic, planner, time between decisions."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from typing import Any

from train.reporting.rows import Row, short_names
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.traffic_spec import written_traffic

_PLACE = ("layout", "num_agents")  # fields of a configuration that tables show


def aspects(config: EnvConfig) -> dict[str, str]:
    """Return what tables name of a configuration."""
    interval = f"{config.time_step * config.action_repeat:g} s"
    return {
        "traffic": written_traffic(config.traffic_spec), "planner": config.planner, "decision interval": interval,
    }  # fmt: skip


def config_of_row(row: Row) -> EnvConfig | None:
    """Return the configuration of a row; None if it has none that this version knows."""
    return _config(json.dumps(row.get("config")))


@cache
def _config(text: str) -> EnvConfig | None:
    try:
        return EnvConfig.from_dict(json.loads(text))
    except ConfigError:
        return None


def _by_aspect(rows: Sequence[Row]) -> dict[str, dict[str, dict[str, None]]]:
    """Return aspect -> value -> the short names of the policies driven with it."""
    short = short_names({str(row["policy"]) for row in rows})
    found: dict[str, dict[str, dict[str, None]]] = {}
    for row in rows:
        for name, value in aspects(config).items() if (config := config_of_row(row)) else ():
            found.setdefault(name, {}).setdefault(value, {})[short[str(row["policy"])]] = None
    return found


def labels(rows: Sequence[Row]) -> dict[str, str]:
    """Return for each policy its short name with its traffic, and with what else policies differ in."""
    short = short_names({str(row["policy"]) for row in rows})
    found = {name: groups for name, groups in _by_aspect(rows).items() if name == "traffic" or len(groups) > 1}
    for name, policy in short.items():
        values = [value for groups in found.values() for value, own in groups.items() if policy in own]
        short[name] = f"{policy} ({', '.join(values)})" if values else policy
    return short


def driven_with(rows: Sequence[Row]) -> str:
    """Return a note that names what policies are driven with, and warns where that differs."""
    found, parts = _by_aspect(rows), []
    unequal = [name for name, groups in found.items() if len(groups) > 1]
    for name, groups in found.items():
        named = [f"{value} ({', '.join(own)})" for value, own in groups.items()] if name in unequal else groups
        parts.append(f"{name} {', '.join(named)}")
    warning = f"Differences between these policies are also due to the {' and '.join(unequal)}. " if unequal else ""
    return f"Driven with {'; '.join(parts)}. {warning}" if parts else ""


def differing(*sides: Sequence[Row]) -> dict[str, tuple[str, ...]]:
    """Return the fields of configuration and version in which sets of rows differ, with the values of each set."""
    found = [{(name, str(value)): None for row in rows for name, value in _settings(row).items()} for rows in sides]
    names = sorted({name for name, _ in set().union(*found) - set(found[0]).intersection(*found)} - {*_PLACE})
    return {name: tuple(" or ".join(v for n, v in one if n == name) or "-" for one in found) for name in names}


def _settings(row: Row) -> dict[str, Any]:
    """Return configuration and version of a row, as flat as "reward.collision"."""
    config = config_of_row(row)
    flat = {"version": row.get("version", "-"), **({} if config is None else config.to_dict() | aspects(config))}
    parts = [(name, value) for name, value in flat.items() if isinstance(value, dict)]
    return flat | {f"{name}.{key}": one for name, part in parts for key, one in flat.pop(name, part).items()}
