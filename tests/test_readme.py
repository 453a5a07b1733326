"""README is short, its Python prints what it says, and its figures are those of docs/."""

from __future__ import annotations

import re
import subprocess
import sys

from tests.pages import PAGES, ROOT, command_lines, fenced

README = PAGES["README.md"]


def table_rows(text: str) -> list[str]:
    """Return the lines of all tables of figures, headings included."""
    tables = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    return [line for table in tables if "--:" in table for line in table.splitlines()]


def test_it_is_short() -> None:
    assert len(README.splitlines()) <= 150
    (example,) = fenced(README, "python")
    assert "parallel_env" in example
    assert len(example.splitlines()) <= 10
    assert {"make demo", "make test"} <= command_lines(README)
    assert "](docs/warehouse.gif)" in README


def test_its_python_prints_what_it_says_each_time() -> None:
    (example,) = fenced(README, "python")
    runs = [subprocess.run([sys.executable, "-c", example], cwd=ROOT, capture_output=True, text=True) for _ in range(2)]
    assert runs[0].stdout == runs[1].stdout
    assert f"`{runs[0].stdout.strip()}`" in README, runs[0].stderr


def test_its_figures_are_rows_of_docs() -> None:
    measured = [row for page, text in PAGES.items() if page.startswith("docs/measured/") for row in table_rows(text)]
    assert len(table_rows(README)) > 4
    assert [row for row in table_rows(README) if row not in measured] == []
