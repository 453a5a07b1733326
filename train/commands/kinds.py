"""`--fleet FILE`: robots of other kinds, as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from train.kinds import KindPart, Kinds
from warehouse_env.checked import Checked, from_plain
from warehouse_env.errors import ConfigError
from warehouse_env.files import read_json

_EXAMPLE = '[{"share": 0.25, "robot": {"length": 1.4}}]'
_MOST = 1_000_000  # bytes of a file


@dataclass(frozen=True)
class Fleet(Checked):
    """The option for other kinds of robots."""

    fleet: Path | None = None
    """Drive other kinds of robots: a JSON file, as [{"share": 0.25, "robot": {"length": 1.4}}]; "share": 1 changes all
    robots."""

    def kinds(self) -> Kinds | None:
        """Return the kinds of robots; None where all are as RobotSpec has them."""
        return None if self.fleet is None else read_fleet(self.fleet)

    def kinds_of(self, robots: int) -> dict[str, Any]:
        """Return the fields of EnvConfig that the option sets for so many robots."""
        kinds = self.kinds()
        return {} if kinds is None else kinds.of(robots)


def read_fleet(path: Path) -> Kinds:
    """Return the kinds in a file such as [{"share": 0.25, "robot": {"length": 1.4}}]; missing fields are RobotSpec's.

    Raises ConfigError or MapError for a file that cannot be used.
    """
    parts = read_json(path, "fleet", _MOST, ConfigError)
    if not isinstance(parts, list) or not parts:
        raise ConfigError(f"fleet {path} must be a list, as {_EXAMPLE}")
    try:
        return Kinds(tuple(from_plain(KindPart, part) for part in parts))
    except ConfigError as error:
        raise ConfigError(f"fleet {path}: {error}") from None
