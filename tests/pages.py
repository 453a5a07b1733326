"""Find code blocks and commands in README and docs/."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parent.parent
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
}
# Packages that only `make clients` installs; blocks that need them run there.
CLIENTS = ("ray", "torchrl", "supersuit")

# Replacements that shorten examples: one rollout instead of hours, one second of film.
SHORTER = {
    "total_timesteps=500_000": "total_timesteps=9_216",
    "simulator.seconds(0) < 40": "simulator.seconds(0) < 21",
    "range(50)": "range(1)",
    "total_frames=30_000": "total_frames=600",
    "begin=20, seconds=10": "begin=0, seconds=1",
    "begin=30, seconds=6": "begin=0, seconds=1",
    "seconds=40, speed=6": "seconds=1",
}


class Block(NamedTuple):
    """A block of Python on a page."""

    page: str
    number: int
    source: str

    @property
    def clients(self) -> list[str]:
        """Return its imports that only `make clients` installs."""
        return [name for name in CLIENTS if re.search(rf"^\s*(from|import) {name}\b", self.source, re.MULTILINE)]

    def run(self) -> dict[str, Any]:
        """Run the shortened block; return its namespace."""
        source = self.source
        for long, short in SHORTER.items():
            source = source.replace(long, short)
        names: dict[str, Any] = {"__name__": "page"}
        exec(compile(source, f"{self.page}, block {self.number}", "exec", dont_inherit=True), names)
        return names

    def __str__(self) -> str:
        return f"{self.page}:{self.number}"


def fenced(text: str, language: str) -> list[str]:
    """Return the contents of all code blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def python_blocks() -> list[Block]:
    """Return all blocks of Python on all pages."""
    return [
        Block(page, number, source)
        for page, text in PAGES.items()
        for number, source in enumerate(fenced(text, "python"), 1)
    ]


def command_lines(text: str) -> set[str]:
    """Return every command in a page's blocks and lines."""
    lines = [line.split(" #")[0].strip() for block in fenced(text, "sh") for line in block.splitlines()]
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    lines += re.findall(r"`(?:source <\()?((?:warehouse|make|pip|python) [^`]+?)\)?`", prose)
    lines += re.findall(r"python -m [\w.]+", text)
    return {" ".join(line.split()) for line in lines if line}
