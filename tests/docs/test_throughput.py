"""The bar chart of throughput shows what its rows say, and its rows are of the same episodes."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.pages import ROOT

pytest.importorskip("matplotlib")


@pytest.fixture
def chart(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the module that draws it."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "extensions"))
    import throughput

    return throughput


def test_it_is_drawn_as_it_is_kept(chart: Any, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = re.findall(r">([^<>]*)</text>", chart.PICTURE.read_text(encoding="utf-8"))
    monkeypatch.setattr(chart, "PICTURE", tmp_path / "again.svg")
    chart.draw()
    assert re.findall(r">([^<>]*)</text>", (tmp_path / "again.svg").read_text(encoding="utf-8")) == kept
