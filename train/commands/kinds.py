"""`--fleet FILE`: the robots of other kinds, as JSON."""

from __future__ import annotations

import json
from pathlib import Path

from warehouse_env.checked import from_plain
from warehouse_env.config import FleetPart
from warehouse_env.errors import ConfigError, shown


def read_fleet(path: Path) -> tuple[FleetPart, ...]:
    """Return the parts of a fleet that a file lists as [{"count": 8, "robot": {"length": 1.4}}], say; what a robot
    leaves out is as RobotSpec has it. ConfigError says what cannot be used.
    """
    try:
        parts = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ConfigError(f"fleet {path} cannot be read: {shown(str(error))[1:-1]}") from None
    if not isinstance(parts, list) or not parts:
        raise ConfigError(f'fleet {path} must be a list, as [{{"count": 8, "robot": {{"length": 1.4}}}}]')
    try:
        return tuple(from_plain(FleetPart, part) for part in parts)
    except ConfigError as error:
        raise ConfigError(f"fleet {path}: {error}") from None
