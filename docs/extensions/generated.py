"""Sphinx directives that generate tables of options and registries, and the commands' help."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import inspect
import io
import os
import re
from typing import Any, Literal, get_args, get_origin, get_type_hints
from unittest import mock

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from tyro import _docstrings

from train.cli import COMMANDS, main
from train.evaluation.fixed_set import SHIPPED, benchmark_tables
from train.reporting.rows import read_rows

COLUMNS = "88"  # characters of a line of help, which fit a window of 1024 pixels
# Types as Sphinx spells them out -> as the source has them.
_TYPES = (
    (r"[\w.~]*ndarray\[tuple\[[\w.~]*Any, \.\.\.\], [\w.~]*dtype\[[\w.~]*?(\w+)\]\]", r"NDArray[\1]"),
    (r"[\w.~]*_?Buffer \| .*?complex \| bytes \| str\]", "ArrayLike"),
    (r"<factory>", "..."),
    (r"^\(\*args, \*\*kwargs\)$", ""),  # of a protocol
)


def looked_up(path: str) -> Any:
    """Return the object at a path such as `warehouse_env.config.RobotSpec`."""
    module, _, name = path.rpartition(".")
    return getattr(importlib.import_module(module), name)


def field_notes(options: type) -> dict[str, str]:
    """Return the docstring of each field of a dataclass, as in the commands' help."""
    notes = {one.name: _docstrings.get_field_docstring(options, one.name, ()) for one in dataclasses.fields(options)}
    return {name: " ".join((note or "").split()) for name, note in notes.items()}


def default_of(field: dataclasses.Field[Any]) -> str:
    """Return a field's default as source code; "" if the field is required."""
    if field.default_factory is not dataclasses.MISSING:
        made = field.default_factory()
        return f"{type(made).__name__}()" if dataclasses.is_dataclass(made) else f"{made!r}, on this machine"
    value = field.default
    if value is dataclasses.MISSING:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value) if hasattr(value, "parts") else repr(value)


def table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a Markdown table."""
    lines = [" | ".join(cell.replace("|", "\\|") for cell in row) for row in (header, ("---",) * len(header), *rows)]
    return "\n".join(f"| {line} |" for line in lines)


def options_table(options: type) -> str:
    """Return a table of a dataclass: each field with type, default, unit and meaning."""
    notes, kinds = field_notes(options), get_type_hints(options)
    rows = [
        (f"`{field.name}`", _kind(kinds[field.name], field.type), _code(default_of(field)), _plain(notes[field.name]))
        for field in dataclasses.fields(options)
    ]
    return table(("option", "type", "default", "unit and meaning"), rows)


def help_of(command: str) -> str:
    """Return the output of `warehouse COMMAND --help`; "" gives the list of commands."""
    text = io.StringIO()
    plain = {"COLUMNS": COLUMNS, "NO_COLOR": "1", "TERM": "dumb"}
    with mock.patch.dict(os.environ, plain), contextlib.redirect_stdout(text):
        if main([*command.split(), "--help"]) != 0:
            raise ValueError(f"warehouse {command} --help failed")
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines())


def _kind(kind: Any, written: object) -> str:
    """Return a type as in the source, without tyro's annotations; a choice gives its values."""
    written = kind if str(written).startswith("Annotated[") else written
    return " or ".join(f"`{value!r}`" for value in get_args(kind)) if get_origin(kind) is Literal else f"`{written}`"


def _code(text: str) -> str:
    return f"`{text}`" if text else ""


def _plain(text: str) -> str:
    """Escape Markdown in a note, except its backticks."""
    parts = text.split("`")
    escaped = ["".join(f"\\{sign}" if sign in "*_[]<>" else sign for sign in part) for part in parts[::2]]
    return "".join(a + (f"`{b}`" if b is not None else "") for a, b in zip(escaped, [*parts[1::2], None], strict=True))


def _marked(found: list[nodes.Node]) -> list[nodes.Node]:
    """Mark tables of options for the style sheet."""
    for one in (one for node in found for one in node.findall(nodes.table)):
        one["classes"].append("options")
    return found


class Options(SphinxDirective):
    """Table of the fields of the dataclass at a path."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        return _marked(self.parse_text_to_nodes(options_table(looked_up(self.arguments[0]))))


class Parameters(SphinxDirective):
    """Tables of all dataclasses of a registry, each with its name and docstring."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return a section for each dataclass."""
        parts: list[str] = []
        for name, one in looked_up(self.arguments[0]).items():
            parts += [f"### {name}", "", _plain(" ".join((inspect.getdoc(one) or "").split("\n\n")[0].split())), ""]
            parts += [options_table(one) if dataclasses.fields(one) else "It has no parameters.", ""]
        return _marked(self.parse_text_to_nodes("\n".join(parts), allow_section_headings=True))


class Commands(SphinxDirective):
    """Help of every command."""

    def run(self) -> list[nodes.Node]:
        """Return the list of commands, then a section for each command."""
        parts = ["## warehouse", "", "```text", help_of(""), "```", ""]
        for name in COMMANDS:
            parts += [f"## warehouse {name}", "", "```text", help_of(name), "```", ""]
        return self.parse_text_to_nodes("\n".join(parts), allow_section_headings=True)


class Board(SphinxDirective):
    """Benchmark tables of the shipped policies."""

    def run(self) -> list[nodes.Node]:
        """Return a table for each track."""
        tables = benchmark_tables(read_rows(SHIPPED))
        parts = [f"**{one.title}**\n\n{table(one.header, list(one.cells))}\n" for one in tables]
        return self.parse_text_to_nodes("\n".join([*parts, tables[0].note]))


def _adapted(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Convert a plain docstring to reStructuredText: escape signs, keep the lines of hanging paragraphs."""
    paragraphs = "\n".join(lines).split("\n\n")
    lines[:] = "\n\n".join(map(_paragraph, paragraphs)).splitlines()


def _paragraph(text: str) -> str:
    first, *rest = text.strip("\n").split("\n")
    hangs = not first.startswith((" ", "-")) and any(line.startswith(" ") for line in rest)
    if hangs and not first.endswith(":"):
        return "::\n\n" + "\n".join(f"    {line}" for line in (first, *rest))
    parts = text.split("`")
    parts[::2] = ["".join(f"\\{sign}" if sign in "\\*|" else sign for sign in part) for part in parts[::2]]
    return "`".join(parts)


def _as_written(text: str) -> str:
    for spelt, written in _TYPES:
        text = re.sub(spelt, written, text)
    return text


def _typed(app: Sphinx, what: str, name: str, obj: object, options: object, *parts: str | None) -> tuple[Any, ...]:
    """Return a signature and its result with types as in the source."""
    return tuple(part and _as_written(part) for part in parts)


def _typed_attribute(app: Sphinx, domain: str, kind: str, content: nodes.Element) -> None:
    """Do the same for properties and attributes, which have no signature event."""
    for one in content.parent.findall(addnodes.desc_annotation) if kind in ("property", "attribute") else ():
        if one.astext() != (text := _as_written(one.astext())):
            one.clear()
            one += nodes.Text(text)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("options", Options)
    app.add_directive("parameters", Parameters)
    app.add_directive("commands", Commands)
    app.add_directive("board", Board)
    app.connect("autodoc-process-docstring", _adapted)
    app.connect("autodoc-process-signature", _typed)
    app.connect("object-description-transform", _typed_attribute)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
