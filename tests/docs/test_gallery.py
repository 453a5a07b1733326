"""The gallery's pictures move, are small, and each stands above the lines that write it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.pages import PAGES, ROOT

SECTIONS = PAGES["docs/gallery.md"].split("\n## ")[1:]
PICTURES = sorted((ROOT / "docs" / "gallery").iterdir())


def test_they_are_under_three_megabytes() -> None:
    assert len(SECTIONS) == len(PICTURES)
    assert sum(path.stat().st_size for path in PICTURES) < 3_000_000


@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.splitlines()[0])
def test_each_stands_above_the_lines_that_make_it(section: str) -> None:
    (picture,) = re.findall(r"!\[[^\]]+\]\(gallery/(\w+)\.gif\)", section)
    assert ROOT / "docs" / "gallery" / f"{picture}.gif" in PICTURES
    (code,) = re.findall(r"^```(?:python|sh)\n(.*?)^```", section, re.MULTILINE | re.DOTALL)
    assert re.search(rf'(film\w*\("{picture}\.gif"|--html {picture}\.html)', code)
    assert len([line for line in code.splitlines() if line]) <= 4


@pytest.mark.parametrize("path", [*PICTURES, ROOT / "docs" / "warehouse.gif"], ids=lambda path: path.stem)
def test_it_moves_and_is_small(path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    assert path.stat().st_size < (400_000 if path in PICTURES else 3_000_000)
    with image.open(path) as film:
        assert film.n_frames >= 15
        first = film.convert("RGB").tobytes()
        film.seek(film.n_frames // 2)
        assert film.convert("RGB").tobytes() != first
