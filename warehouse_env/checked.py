"""Dataclasses that check their values: every field must fit its annotation.

Own code, because no library does this: pydantic and msgspec convert "3" to 3 or refuse NumPy's numbers; beartype and
typeguard accept True as a number, convert nothing and report errors in paragraphs.
"""

import dataclasses
import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, ClassVar, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from warehouse_env.errors import ConfigError, check_known, shown

T = TypeVar("T")

_KINDS: dict[type, dict[str, Any]] = {}  # read once: it takes longer than all checks


class _WrongError(Exception):
    """A value that does not fit an annotation."""


class Checked:
    """Base of a frozen dataclass whose values are converted to plain Python of their annotations, or ConfigError.

    bool, None, Literal and dataclasses are accepted as they are; str and Path accept each other. int and float also
    accept NumPy's numbers, float only finite ones, neither a bool. A tuple accepts lists and arrays. So instances stay
    hashable, and JSON-able where their annotations are.
    """

    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {}  # of fields, or of each entry; those of bases hold, too
    retired: ClassVar[dict[str, Any]] = {}  # removed fields that old files still name -> the only value they may have

    @classmethod
    def upgraded(cls, data: dict[str, Any]) -> dict[str, Any]:
        """Return stored fields under today's names; a subclass overrides this for renamed fields."""
        return data

    def __post_init__(self) -> None:
        """Check all fields and ranges; a subclass that checks more calls this first."""
        for name, kind in _kinds_of(type(self)).items():
            try:
                object.__setattr__(self, name, _fitted(getattr(self, name), kind))
            except _WrongError:
                self._require(False, name, _rule(kind))
        for cls in reversed(type(self).__mro__):
            for name, limits in vars(cls).get("ranges", {}).items():
                self._between(*limits, name)

    def _called(self, name: str) -> str:
        """Return the name of a field in errors."""
        return name

    def _between(self, low: float, high: float, *names: str) -> None:
        """Raise ConfigError unless each field, or each entry of a tuple, lies within low..high."""
        for name in names:
            value = getattr(self, name)
            entries = value if isinstance(value, tuple) else (value,)
            if not all(entry is None or low <= entry <= high for entry in entries):
                self._require(False, name, within(low, high, each=isinstance(value, tuple)))

    def _require(self, condition: bool, name: str, rule: str) -> None:
        """Raise ConfigError with the rule of a field unless the condition holds."""
        if not condition:
            raise ConfigError(f"{self._called(name)}={shown(getattr(self, name))} must be {rule}")


class CheckedPart(Checked):
    """Options inside other options; errors name the class, because fields may have the same names."""

    def _called(self, name: str) -> str:
        """Return the name of a field in errors, such as TrafficSpec.margin."""
        return f"{type(self).__name__}.{name}"


def within(low: float, high: float, each: bool = False) -> str:
    """Describe the range low..high: whole numbers if both ends are; `each`: of the entries of a tuple."""
    whole = isinstance(low, int) and isinstance(high, int)
    kind = f"{'' if each else 'a '}{'whole ' if whole else ''}number{'s' if each else ''}"
    return f"{kind} from {low:,} to {high:,}" if whole else f"{kind} from {low:g} to {high:g}"


def from_plain(cls: type[T], data: Any) -> T:
    """Build a dataclass, and those inside it, from JSON types; `retired` fields are skipped.

    ConfigError for anything but an object, an unknown or missing name, and a wrong value.
    """
    if isinstance(data, dict) and issubclass(cls, Checked):
        data = cls.upgraded(data)
    data = _without_retired(cls, data)
    check_names(f"{cls.__name__} parameter", data, cls)
    for field in dataclasses.fields(cls):  # type: ignore[arg-type]
        missing = field.default is field.default_factory is dataclasses.MISSING
        if missing and field.name not in data:
            raise ConfigError(f"{cls.__name__} lacks the entry {field.name!r}")
    kinds = _kinds_of(cls)
    return cls(**{name: _built(value, kinds[name]) for name, value in data.items()})


def _built(value: Any, kind: Any) -> Any:
    """Return JSON types with the dataclasses of an annotation, such as `Part | None`, built from objects."""
    part = next((one for one in (kind, *get_args(kind)) if dataclasses.is_dataclass(one)), None)
    if part is None:
        return value
    if isinstance(value, (list, tuple)):
        return [_built(one, part) for one in value]
    return from_plain(part, value) if isinstance(value, dict) else value  # type: ignore[arg-type]


def _without_retired(cls: type, data: Any) -> Any:
    """Return JSON types without retired parameters; ConfigError where one had another value than the fixed one."""
    retired: dict[str, Any] = getattr(cls, "retired", {})
    if not isinstance(data, dict) or retired.keys().isdisjoint(data):
        return data
    for name, value in retired.items():
        if data.get(name, value) != value:
            raise ConfigError(
                f"{cls.__name__} parameter {name!r} is no option any more: it is {shown(value)} for all, so what was "
                f"made with {shown(data[name])} cannot run as it did"
            )
    return {name: value for name, value in data.items() if name not in retired}


def check_names(what: str, given: Any, owner: Any) -> None:
    """Raise ConfigError unless `given` is a dict, with near matches for a key that is no field of dataclass `owner`."""
    if not isinstance(given, dict):
        raise ConfigError(f"{what}s must be an object of names and values, not {shown(given)}")
    check_known(what, given, [field.name for field in dataclasses.fields(owner)])


def parse_named(text: Any, kind: str, example: str) -> tuple[Any, dict[str, Any]]:
    """Read "NAME:KEY=VALUE,KEY=VALUE" as a name and its parameters; anything but a text is returned as it is.

    Values are JSON; words need no quotes. ConfigError names the `kind` and an example.
    """
    if not isinstance(text, str):
        return text, {}
    name, _, rest = text.partition(":")
    found: dict[str, Any] = {}
    for part in rest.split(",") if rest else ():
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not (key and equals and value):
            raise ConfigError(f"{kind} {shown(name)[1:-1]}: {shown(part)} must be PARAMETER=VALUE, as in {example}")
        try:
            found[key] = json.loads(value)
        except (ValueError, RecursionError):  # a word, or nothing that JSON can hold
            found[key] = value
    return name, found


def _kinds_of(cls: type) -> dict[str, Any]:
    """Return field -> type of a dataclass."""
    if cls not in _KINDS:
        hints = get_type_hints(cls)
        _KINDS[cls] = {field.name: hints[field.name] for field in dataclasses.fields(cls)}
    return _KINDS[cls]


def _fitted(value: Any, kind: Any) -> Any:
    """Return a value as plain Python of a type; raises _WrongError."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return _fitted_to_one(value, inner)
    if origin is tuple:
        several = isinstance(value, Sequence) and not isinstance(value, (str, bytes, bytearray))
        if not several and not (isinstance(value, np.ndarray) and value.ndim):
            raise _WrongError
        return tuple(_fitted(entry, inner[0]) for entry in value)
    if kind is Any or (origin is dict and isinstance(value, dict)):
        return value
    if kind is float:
        return _finite(value)
    if kind is int and isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        return int(value)
    if kind is bool and isinstance(value, (bool, np.bool_)):
        return bool(value)
    if kind in (str, Path) and isinstance(value, (str, os.PathLike)):
        return kind(value)
    if origin is Literal and isinstance(value, str) and value in inner:
        return str(value)
    if isinstance(kind, type) and (kind is NoneType or dataclasses.is_dataclass(kind)) and isinstance(value, kind):
        return value
    raise _WrongError


def _fitted_to_one(value: Any, kinds: tuple[Any, ...]) -> Any:
    """Return a value as plain Python of the first type that it fits; raises _WrongError."""
    for kind in kinds:
        try:
            return _fitted(value, kind)
        except _WrongError:
            continue
    raise _WrongError


def _finite(value: Any) -> float:
    """Return a finite float; raises _WrongError."""
    if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            raise _WrongError from None
        if math.isfinite(number):
            return number
    raise _WrongError


_RULES = {
    float: "a finite number", int: "a whole number", bool: "True or False", str: "a text", Path: "a path",
    NoneType: "None",
}  # fmt: skip


def _rule(kind: Any) -> str:
    """Describe the values that fit a type."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return " or ".join(map(_rule, inner))
    if origin is tuple:
        return f"a list with {_rule(inner[0])} in each place"
    if origin is Literal:
        return f"one of {', '.join(inner)}"
    if origin is dict:
        return "an object of names and values"
    return _RULES.get(kind) or f"a {kind.__name__}"
