"""Pages: text, tables and pictures in one HTML file that works offline, light or dark."""

import platform
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import jinja2
from markupsafe import Markup, escape

from train.reporting.report import Table
from warehouse_env import __version__
from warehouse_env.files import write_text

_BOUND_TO = ("numpy", "numba", "torch")  # packages that may affect figures


class Shown(NamedTuple):
    """A drawing as HTML (SVG), and what is said below it."""

    drawing: str
    caption: str


class Link(NamedTuple):
    """A link: a path relative to the page, a title and a text."""

    target: str
    title: str
    text: str


@dataclass(frozen=True)
class PagePart:
    """The content under a heading, in this order; texts may use Markdown's bold, italics and code."""

    heading: str = ""
    text: str = ""
    pictures: Sequence[Shown] = ()
    tables: Sequence[Table] = ()
    links: Sequence[Link] = ()
    facts: dict[str, str] = field(default_factory=dict)
    points: Sequence[str] = ()  # of a list, behind the pictures


@dataclass(frozen=True)
class Page:
    """A title, the answer in words (paragraphs), and parts."""

    title: str
    subtitle: str = ""
    words: Sequence[str] = ()
    parts: Sequence[PagePart] = ()

    def html(self) -> str:
        """Return the page as a file's text."""
        return _template().render(page=self, number=_number)

    def write(self, path: Path) -> None:
        """Write the page, all of it or nothing."""
        write_text(path, self.html())


@cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.filters["inline"] = _inline
    return environment.from_string((Path(__file__).parent / "page.html").read_text(encoding="utf-8"))


def _number(table: Table, column: int) -> Markup:
    return Markup(' class="number"') if table.numeric(column) else Markup("")


def _inline(text: str) -> Markup:
    """Return Markdown's bold, italics and code as HTML; cells "better" and "worse" are coloured."""
    parts = str(escape(text))
    for sign, tag in (("**", "b"), ("*", "i"), ("`", "code")):
        pieces = parts.split(sign)
        parts = "".join(piece if index % 2 == 0 else f"<{tag}>{piece}</{tag}>" for index, piece in enumerate(pieces))
    return Markup(f'<span class="{text}">{parts}</span>' if text in ("better", "worse") else parts)


def made_by(**facts: str) -> dict[str, str]:
    """Return the facts given with the command as typed and the versions of the packages."""
    command = shlex.join(["warehouse", *sys.argv[1:]])
    versions = [f"warehouse-env {__version__}", f"Python {platform.python_version()}"]
    versions += [f"{name} {version(name)}" for name in _BOUND_TO]
    return {"Command": f"`{command}`", **facts, "Versions": ", ".join(versions)}
