"""The chart of gaps: drawn whole, also with planners that never arrive and without any planner."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from warehouse_env.render.gap_charts import Spread, gap_spreads

pytest.importorskip("matplotlib")

EXACT = Spread("astar", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
ANTS = Spread("aco", 3.0, 1.0, 9.0, 20.0, 60.0, 0.25)
LOST = Spread("apf", math.nan, math.nan, math.nan, math.nan, math.nan, 1.0)


@pytest.mark.parametrize("panels", [{"a": [EXACT, ANTS, LOST]}, {k: [EXACT, LOST] for k in "abcd"}, {"a": []}, {}])
def test_it_is_drawn(panels: dict[str, list[Spread]], tmp_path: Path) -> None:
    path = tmp_path / "gaps.png"
    gap_spreads(panels, path, "title")
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert list(tmp_path.iterdir()) == [path]
