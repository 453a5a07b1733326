"""Looks by the ants and by the search: the rows of a small crowd, and the table by hand."""

from __future__ import annotations

import pytest

from train.benchmarks import looks


def test_ants_are_held_against_the_search_at_the_same_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(looks, "FLOORS", ("narrow",))
    monkeypatch.setattr(looks, "ROBOTS", (24,))
    monkeypatch.setattr(looks, "WARM", 4)
    rows = list(looks.looks(1.0, seed=0))
    assert [row["on_its_way"] for row in rows] in ([True], [False, True])
    row = rows[-1]
    assert row["looks"] > 20
    assert 0 < row["ants_found"] <= row["search_found"] <= row["looks"]
    assert 0.0 <= row["gap_share"] < 0.1
    assert row["cheapest"] > 0.3
