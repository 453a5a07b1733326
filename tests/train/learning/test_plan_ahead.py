"""Plans that a training makes before it begins."""

from __future__ import annotations

from pathlib import Path

import pytest

from train import books
from train.learning.config import TrainingConfig
from train.learning.plan_ahead import plan_ahead


@pytest.mark.parametrize(("steps", "traffic"), [(10**9, "none"), (1000, "none"), (10**9, "routes")])
def test_a_training_makes_the_plan_table_of_a_floor_where_it_pays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: int, traffic: str
) -> None:
    monkeypatch.setenv("WAREHOUSE_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(books, "_books", {})
    floor = tmp_path / "small.map"
    floor.write_text("type octile\nheight 3\nwidth 4\nmap\n....\n.@@.\n....\n")
    config = TrainingConfig(layouts=(str(floor),), robots=(1, 2), steps=steps, traffic=traffic, planner="pf_aco")
    plan_ahead(config)
    pays = steps > 1000 and traffic == "none"  # live routes of pf_aco need no plans
    assert books.book_of(config.env(str(floor), 1)).has_table == pays
    assert len(list(tmp_path.glob("plans-*.npz"))) == pays
