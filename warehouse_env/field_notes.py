"""What the source says beside the fields of a dataclass: its docstring, the comment behind it, or those above it."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import io
import textwrap
import tokenize
from functools import cached_property
from typing import Any, TypeVar

T = TypeVar("T")


def documented(options: type[T]) -> type[T]:
    """Let `help()` of a dataclass say, after its docstring, what its source says about each field.

    The source is read when somebody asks: importing pays nothing.
    """
    options.__doc__ = _Documentation(options, options.__doc__ or "")  # type: ignore[assignment]
    return options


class _Documentation:
    """A class's `__doc__`, put together on first use; without the source, and for subclasses, the docstring alone."""

    def __init__(self, options: type, docstring: str) -> None:
        self._options, self._docstring = options, docstring

    def __get__(self, instance: object, owner: type | None = None) -> str:
        return self._whole

    @cached_property
    def _whole(self) -> str:
        try:
            notes = field_notes(self._options)
        except OSError:
            return self._docstring
        fields = (f"{one.name} = {default_of(one)}: {notes[one.name]}" for one in dataclasses.fields(self._options))
        return "\n".join([inspect.cleandoc(self._docstring), "", *fields])


def field_notes(options: type) -> dict[str, str]:
    """Return for each field of a dataclass what its source says about it; "" where that is nothing."""
    notes: dict[str, str] = {}
    for one in reversed(options.__mro__):
        if dataclasses.is_dataclass(one):
            notes |= _notes_of(textwrap.dedent(inspect.getsource(one)))
    return {field.name: notes[field.name] for field in dataclasses.fields(options)}


def _notes_of(source: str) -> dict[str, str]:
    (body,) = (node.body for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    comments = _comments(source)
    notes: dict[str, str] = {}
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            notes[node.target.id] = _docstring(after) or _commented(comments, node.lineno, node.end_lineno or 0)
    return notes


def _docstring(node: ast.stmt | None) -> str:
    told = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    return " ".join(node.value.value.split()) if told else ""  # type: ignore[union-attr]


def _comments(source: str) -> dict[int, tuple[str, bool]]:
    """Return the comment of each line, and whether it has the line for itself."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    found = [token for token in tokens if token.type == tokenize.COMMENT]
    return {one.start[0]: (one.string.lstrip("# "), not one.line[: one.start[1]].strip()) for one in found}


def _commented(comments: dict[int, tuple[str, bool]], first: int, last: int) -> str:
    above: list[str] = []
    while comments.get(first - 1, ("", False))[1]:
        first -= 1
        above.insert(0, comments[first][0])
    return " ".join([*above, *([comments[last][0]] if last in comments else [])])


def default_of(field: dataclasses.Field[Any]) -> str:
    """Return a field's default as one would write it; "" where it must be given."""
    if field.default_factory is not dataclasses.MISSING:
        made = field.default_factory()
        return f"{type(made).__name__}()" if dataclasses.is_dataclass(made) else f"{made!r}, on this machine"
    return "" if field.default is dataclasses.MISSING else _written(field.default)


def _written(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value) if hasattr(value, "parts") else repr(value)
