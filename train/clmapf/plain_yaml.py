"""The part of YAML that the benchmark's files use: mappings and lists by indentation, numbers, names, [1, 2] in a line.

Nothing else is read: no tags, anchors, aliases, quotes or texts over several lines, so that a file can hold nothing but
numbers and names, and takes time and memory in proportion to its length.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any, NamedTuple

from warehouse_env.errors import MapError, shown
from warehouse_env.files import path_of

_DEEPEST = 8  # mappings and lists within each other
_LARGEST = 64 * 2**20  # [bytes]
_KEY = re.compile(r"([A-Za-z_][\w-]*)\s*:(?:\s+(.*)|$)")
_NAME = re.compile(r"[A-Za-z_][\w.-]*")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


class _Line(NamedTuple):
    number: int
    indent: int
    text: str


def read_plain_yaml(path: Path) -> Any:
    """Return what a file holds: dicts, lists, floats and names; MapError says in which line it is something else."""
    path = path_of(path, MapError)
    try:
        if path.stat().st_size > _LARGEST:
            raise MapError(f"{path} has more than {_LARGEST >> 20} MB, and is no file of the benchmark")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MapError(f"cannot read {path}: {getattr(error, 'strerror', None) or 'it is no text'}") from error
    return parse_plain_yaml(text, str(path))


def parse_plain_yaml(text: str, name: str) -> Any:
    """Return what a text holds, as `read_plain_yaml` does; name: what errors call it."""
    lines = _lines(text, name)
    if not lines:
        raise MapError(f"{name} is empty")
    value, rest = _block(lines, 0, name, 1)
    if rest < len(lines):
        raise _wrong(lines[rest], name, "is indented unlike the lines before it")
    return value


def _lines(text: str, name: str) -> list[_Line]:
    lines = []
    for number, raw in enumerate(text.splitlines(), start=1):
        body = raw.split(" #")[0].rstrip()
        bare = body.lstrip(" ")
        if not bare or bare.startswith("#") or bare == "---":
            continue
        if "\t" in bare[:1]:
            raise MapError(f"{name} line {number} is indented by a tab; spaces are needed")
        lines.append(_Line(number, len(body) - len(bare), bare))
    return lines


def _wrong(line: _Line, name: str, what: str) -> MapError:
    return MapError(f"{name} line {line.number}: {shown(line.text)} {what}")


def _block(lines: list[_Line], at: int, name: str, depth: int) -> tuple[Any, int]:
    """Return the mapping, list or value that begins with a line, and the line after it."""
    if depth > _DEEPEST:
        raise _wrong(lines[at], name, f"is deeper than {_DEEPEST} levels")
    if lines[at].text == "-" or lines[at].text.startswith("- "):
        return _list(lines, at, name, depth)
    if _KEY.match(lines[at].text):
        return _mapping(lines, at, name, depth)
    return _value(lines[at].text, lines[at], name), at + 1


def _list(lines: list[_Line], at: int, name: str, depth: int) -> tuple[list[Any], int]:
    indent, items = lines[at].indent, []
    while at < len(lines) and lines[at].indent == indent and (lines[at].text + " ").startswith("- "):
        line = lines[at]
        rest = line.text[1:].lstrip()
        if not rest:
            raise _wrong(line, name, "must have its value in the same line")
        lines[at] = line._replace(indent=indent + len(line.text) - len(rest), text=rest)
        item, at = _block(lines, at, name, depth + 1)
        items.append(item)
    return items, at


def _mapping(lines: list[_Line], at: int, name: str, depth: int) -> tuple[dict[str, Any], int]:
    indent, found = lines[at].indent, {}
    while at < len(lines) and lines[at].indent == indent and (key := _KEY.fullmatch(lines[at].text)):
        line = lines[at]
        if key[1] in found:
            raise _wrong(line, name, "gives the same name twice")
        at += 1
        if key[2]:
            found[key[1]] = _value(key[2], line, name)
        elif at < len(lines) and _is_below(lines[at], indent):
            found[key[1]], at = _block(lines, at, name, depth + 1)
        else:
            found[key[1]] = []
    return found, at


def _is_below(line: _Line, indent: int) -> bool:
    """Whether a line belongs to a name above it: deeper, or a list's first item."""
    return line.indent > indent or (line.indent == indent and line.text.startswith("- "))


def _value(text: str, line: _Line, name: str) -> Any:
    """Return a number, a name, or a list of numbers in brackets."""
    if text.startswith("[") and text.endswith("]"):
        inner = text[1:-1].strip()
        return [_number(part.strip(), line, name) for part in inner.split(",")] if inner else []
    return text if _NAME.fullmatch(text) else _number(text, line, name)


def _number(text: str, line: _Line, name: str) -> float:
    if len(text) > 60 or not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
        raise _wrong(line, name, f"must hold a number where {shown(text)} stands")
    return float(text)
