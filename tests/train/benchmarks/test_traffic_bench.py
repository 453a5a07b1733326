"""What right of way costs: every set of options is timed in turns, and ratios are those of the same chunk."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import pytest

from train.benchmarks import traffic
from train.benchmarks.traffic import OPTIONS, traffic_table


def test_ratios_by_a_clock_in_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(traffic, "ROBOTS", (2,))
    monkeypatch.setattr(traffic, "WARM", 1)
    spent = itertools.cycle((1.0, 2.0, 3.0, 4.0))  # [s] of each world's chunk, world after world
    now, readings = 0.0, itertools.count()

    def clock() -> float:
        nonlocal now
        if next(readings) % 2:  # the second reading of a pair
            now += next(spent)
        return now

    monkeypatch.setattr(traffic, "time", SimpleNamespace(perf_counter=clock))  # not that of the planners
    rows = list(traffic.traffic(0.01, seed=0))
    assert [row["options"] for row in rows] == list(OPTIONS)
    assert [row["over_none"] for row in rows] == pytest.approx([1.0, 2.0, 3.0, 4.0])
    assert rows[3]["ms"] == pytest.approx(1000 * 4.0 / traffic.LEAST)
    table = traffic_table(rows)
    assert [line[5] for line in table.cells] == ["1", "2", "3", "4"]
