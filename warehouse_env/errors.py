"""Errors of bad input: one subclass of ValueError for each kind, each with a message of one clear sentence."""

import difflib
import math
from collections.abc import Collection, Iterable
from numbers import Integral
from typing import Any, SupportsInt

_SHOWN = 80  # characters of a wrong value that an error repeats


class WarehouseError(ValueError):
    """Any bad input; the command line prints it as one sentence and exits with code 2."""


class ConfigError(WarehouseError):
    """A parameter is out of its range, or names something unknown."""


class MapError(WarehouseError):
    """A map or scenario cannot be read or used."""


class MapWarning(UserWarning):
    """A map feature that its floor does not represent."""


class PlanError(WarehouseError):
    """No route exists, or a start or goal cannot be used."""


class ActionError(WarehouseError):
    """An action has the wrong shape, type or a non-finite value."""


class WeightsError(WarehouseError):
    """A weights folder is incomplete, damaged, or made for another observation or action."""


class LostError(WarehouseError):
    """Jobs were lost with their processes, or a broker became unreachable.

    All other jobs, and all that the broker had sent, are kept. The command line exits with code 3.
    """


def shown(value: Any) -> str:
    """Return a wrong value as text for an error message: on one line, cut if long."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # from the value's own code, or from Python for a number of thousands of digits
        text = f"(a value of type {type(value).__name__})"
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


def counted(count: SupportsInt, noun: str) -> str:
    """Return "1 robot", "16 robots"."""
    return f"{int(count):,} {noun}{'s' * (int(count) != 1)}"


def unknown_name(kind: str, name: Any, known: Iterable[str]) -> ConfigError:
    """Return (not raise) the error for a name that is not in a registry, with its nearest matches."""
    names = sorted(known)
    near = difflib.get_close_matches(name[:_SHOWN], names, n=3, cutoff=0.5) if isinstance(name, str) else []
    hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(names)}"
    return ConfigError(f"unknown {kind} {shown(name)}; {hint}")


def check_known(kind: str, names: Iterable[Any], known: Collection[Any]) -> None:
    """Raise `unknown_name` for the first of `names` that is not known."""
    for name in names:
        if name not in known:
            raise unknown_name(kind, name, known)


def check_count(what: str, count: object, least: int = 1, most: float = math.inf) -> int:
    """Return a count as a Python int; ConfigError unless it is a whole number from `least` to `most`."""
    if isinstance(count, bool) or not isinstance(count, Integral) or int(count) < least:
        raise ConfigError(f"{what}={shown(count)} must be a whole number of at least {least}")
    if int(count) > most:
        raise ConfigError(f"{what}={shown(count)} must be a whole number of at most {most}")
    return int(count)
