"""The walk in C: the same moves as ours in every mode of the loop, and a plain note where there is no compiler."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from train.benchmarks.ant_walk import Walk, c_walk, compare, same_moves
from train.benchmarks.parts import Budget, ant_walk
from train.commands.bench import tables
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning.ants.aco import Aco
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.floor import Floor
from warehouse_env.planning.ants.pf_aco import PfAco
from warehouse_env.planning.ants.system import AntSystem
from warehouse_env.planning.ants.walks import empty_walks

TINY = Budget(seconds=0.02, largest=32, threads=(1,), action_repeat=1, seed=0)


@dataclass(frozen=True)
class Greedy(Aco):
    """Uses what Aco does not: greed, and the local update that writes into the trails while ants walk."""

    def colony(self, grid: GridMap, floor: Floor, start: NDArray[np.int64]) -> Colony:
        return replace(super().colony(grid, floor, start), greedy=lambda _: 0.4, local_decay=0.1, local_level=0.5)


@pytest.fixture(scope="module")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> Walk:
    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler")
    return c_walk(tmp_path_factory.mktemp("walk"))


@pytest.mark.parametrize(
    "system",
    [
        PfAco(ants=10, iterations=8),
        Aco(ants=10, iterations=8, dead_end="die"),
        Greedy(ants=10, iterations=8),
    ],
    ids=["backtrack", "die", "greedy"],
)
def test_the_same_moves(system: AntSystem, in_c: Walk) -> None:
    grid = make_layout("random", share=0.3, seed=2)
    cells = [(row, column) for row, column in grid.free_cells.tolist()]
    for seed in range(3):
        compared = compare(system, grid, cells[0], cells[-1], in_c, seed)
        assert compared.same
        assert min(compared.ours, compared.c) > 0


def test_other_moves_are_noticed() -> None:
    one, other = empty_walks(np.zeros(2, np.int64), 4), empty_walks(np.zeros(2, np.int64), 4)
    one.steps[:] = other.steps[:] = (2, -1)
    one.moves[0, :3] = (1, 2, 3)
    other.moves[0, :3] = (1, 2, 4)
    other.moves[1] = 7
    assert same_moves(one, other)  # what lies behind the steps does not count
    other.moves[0, 1] = 5
    assert not same_moves(one, other)
    other.moves[0, 1], other.steps[1] = 2, 0
    assert not same_moves(one, other)


def test_the_part_of_the_bench(in_c: Walk) -> None:
    rows = list(ant_walk(TINY))
    assert {row["planner"] for row in rows} == {"pf_aco", "aco"}
    for row in rows:
        assert row["same_moves"]
        assert row["over_c"] == pytest.approx(row["ms"] / row["c_ms"])
    (table,) = tables([{"what": "ant_walk", **row} for row in rows])
    assert table.cells[0][:3] == ("pf_aco", "in_zone_1", "50 x 100")


def test_without_a_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(WarehouseError, match="no C compiler: install one"):
        c_walk(tmp_path)
    (row,) = ant_walk(TINY)
    (table,) = tables([{"what": "ant_walk", **row}])
    assert "no C compiler" in table.note
    assert not table.cells
