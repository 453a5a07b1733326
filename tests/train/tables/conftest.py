"""Make a study of two tiny floors the only one of the catalogue, and provide rows like those of a run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from train.tables import catalogue, runner
from train.tables.study import TableSetting, TableTask
from warehouse_env.maps.grid_map import GridMap


def settings() -> tuple[TableSetting, ...]:
    """Return an open floor of 5 x 5 and two floors of 6 x 6 with one shelf each."""
    shelves = []
    for row in (2, 3):
        occupied = np.zeros((6, 6), dtype=np.bool_)
        occupied[row, row] = True
        shelves.append(TableTask(GridMap(occupied, name=f"shelf {row}"), (0, 0), (5, 5)))
    one = TableTask(GridMap(np.zeros((5, 5), dtype=np.bool_), name="open"), (0, 0), (4, 4))
    return TableSetting("open", (one,)), TableSetting("shelves", tuple(shelves))


TOY = """
paper = "a toy"
runs = 3
measures = ["best", "mean", "optimal_share", "turns", "ms"]
systems = [
    { label = "ants", planner = "pf_aco:ants=8,iterations=3" },
    { label = "dijkstra", planner = "dijkstra" },
]

[[studies]]
name = "toy"
title = "A toy table"
settings = "toy"
note = "A note."
printed = [
    { setting = "open", system = "theirs", ours = "ants", figures = { mean = 6.0 } },
    { setting = "open", system = "another", figures = { turns = 2 } },
]
claims = [{ text = "ants are as good", ours = "ants", other = "dijkstra", measure = "mean" }]
"""


def row(setting: str, system: str, length: float | None, run: int = 0, number: int = 0, **more: Any) -> dict[str, Any]:
    """Return a row of the toy study with an optimum of 10; length None means no path."""
    found = length is not None
    return {
        "study": "toy", "setting": setting, "system": system, "number": number, "run": run, "success": found,
        "length": length, "optimal_length": 10.0, "gap": length / 10 - 1 if length is not None else None,
        "turns": 3 if found else None, "min_turns": 2, "converged_at": 5 if found else None,
        "cpu_ms": 2.0, "line_length": length, "last": length, "contacts": 0, "apart": 1.0, **more,
    }  # fmt: skip


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
