"""The toy study as the only one of the catalogue."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.train.tables.toy import TOY, settings
from train.tables import catalogue, runner


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Make the toy study the only one of the catalogue; return its file."""
    path = tmp_path / "studies" / "toy.toml"
    path.parent.mkdir()
    path.write_text(TOY)
    monkeypatch.setattr(catalogue, "FOLDER", path.parent)
    monkeypatch.setitem(catalogue.SETTINGS, "toy", settings)
    monkeypatch.setattr(runner, "PAPERS", ("toy",))
    yield path
    for cached in (catalogue.studies_of, catalogue.settings_of):
        cached.cache_clear()
