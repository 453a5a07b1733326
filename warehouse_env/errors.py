"""What can be wrong with what a user gives: one ValueError subclass a kind, one clear sentence each."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class WarehouseError(ValueError):
    """Any bad input; the command line prints it as one sentence and exits with code 2."""


class ConfigError(WarehouseError):
    """A parameter is out of its range, or names something unknown."""


class MapError(WarehouseError):
    """A map or scenario cannot be read or used."""


class PlanError(WarehouseError):
    """No route exists, or a start or goal cannot be used."""


class ActionError(WarehouseError):
    """An action has the wrong shape, type or a non-finite value."""


class WeightsError(WarehouseError):
    """A weights folder is incomplete, damaged, or made for another observation or action."""


def unknown_name(kind: str, name: str, known: Iterable[str]) -> ConfigError:
    """Return (not raise) the error for a name that a registry does not hold, with its nearest matches."""
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(names)}"
    return ConfigError(f"unknown {kind} {name!r}; {hint}")
