"""Other libraries' planners behind our protocol: where installed they plan on our maps, by their rules of corners."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from train.tables.benchmark import peers
from train.tables.benchmark.maps import make_map, make_tasks
from train.tables.benchmark.peers import PEERS, Peer, cutting_length, installed, missing_note, touches_corner
from train.tables.benchmark.runs import made_by, measure, warm_up
from warehouse_env.errors import ConfigError, PlanError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Plan, path_length, validate

RNG = np.random.default_rng(0)


def drawn(*rows: str) -> GridMap:
    return GridMap(np.array([[c == "#" for c in row] for row in rows]))


GRID = drawn(
    ".......",
    ".##.#..",
    ".#...#.",
    ".......",
)


@pytest.fixture(params=PEERS)
def peer(request: pytest.FixtureRequest) -> Peer:
    made = PEERS[request.param]
    if not installed(made):
        pytest.skip(f"{made.package} is not installed")
    return made()


def test_a_peer_plans_by_its_rules(peer: Peer) -> None:
    start, goal = (0, 0), (2, 4)
    plan = peer.plan(GRID, start, goal, np.random.default_rng(1))
    assert plan.found
    assert plan.seconds > 0
    assert (tuple(plan.cells[0]), tuple(plan.cells[-1])) == (start, goal)
    if peer.cuts_corners:
        assert path_length(plan.cells) >= cutting_length(GRID, start, goal) - 1e-9
    else:
        validate(GRID, plan.cells, start, goal)
        if peer.name != "aco-routing":
            assert path_length(plan.cells) == pytest.approx(float(GRID.distance_to(goal)[start]))


def test_a_map_is_prepared_once_and_before_its_plans_are_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    prepared: list[GridMap] = []

    class Counting(Peer):
        name = "counting"
        most_pairs = 1  # as for the slow ones: nothing is planned beforehand

        @staticmethod
        def prepare(grid: GridMap) -> None:
            prepared.append(grid)

        def search(self, prepared: None, start: Cell, goal: Cell, rng: np.random.Generator) -> Sequence[Sequence[int]]:
            return []

    monkeypatch.setitem(PEERS, "counting", Counting)
    warm_up.__wrapped__("counting", "paper46", make_tasks("paper46", 1, 0)[0])
    assert prepared == [make_map("paper46")]
    grids = [drawn("." * size) for size in range(2, 22)]
    for grid in [*grids, *grids]:  # as the benchmark does: map after map, then all over again
        Counting().plan(grid, (0, 0), (0, 1), RNG)
    assert prepared[1:] == grids


def test_a_peer_without_a_path_gives_an_empty_plan(peer: Peer) -> None:
    walled = drawn("..#.", "..#.")
    plan = peer.plan(walled, (0, 0), (0, 3), RNG)
    assert not plan.found
    assert plan.cells.shape == (0, 2)


def test_a_peer_says_its_version_and_refuses_what_it_cannot(peer: Peer) -> None:
    assert peer.key.startswith(f"{peer.package}==")
    assert len(made_by(peer.name, "paper46", 0)) == 16
    with pytest.raises(ConfigError, match="takes no cost map"):
        peer.plan(GRID, (0, 0), (3, 6), RNG, cost=np.zeros(GRID.shape))
    with pytest.raises(PlanError, match="stands on a shelf"):
        peer.plan(GRID, (1, 1), (3, 6), RNG)


def test_ants_of_another_library_leave_pythons_random_numbers_alone() -> None:
    if not installed(PEERS["aco-routing"]):
        pytest.skip("aco-routing is not installed")
    random.seed(3)
    state = random.getstate()
    first, again = (PEERS["aco-routing"]().plan(GRID, (0, 0), (3, 6), np.random.default_rng(5)) for _ in range(2))
    assert random.getstate() == state
    np.testing.assert_array_equal(first.cells, again.cells)


class Broken(Peer):
    """Raises what it likes, or gives what it likes."""

    name = "broken"
    package = "numpy"
    needs = ("no_such_module",)
    cells: Sequence[Cell] | None = None

    @staticmethod
    def prepare(grid: GridMap) -> Any:
        return None

    def search(self, prepared: Any, start: Cell, goal: Cell, rng: np.random.Generator) -> Sequence[Sequence[int]]:
        if type(self).cells is None:
            raise RuntimeError("no path found")
        return type(self).cells


def test_a_peer_that_raises_found_nothing() -> None:
    assert not Broken().plan(GRID, (0, 0), (3, 6), RNG).found
    assert not installed(Broken)


def test_one_plain_note_on_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "installed", lambda peer: peer.name in ("networkx", "pyastar2d"))
    assert (
        missing_note()
        == "Not installed, so not measured: pathfinding, aco-routing (pip install pathfinding aco-routing)."
    )
    monkeypatch.setattr(peers, "installed", lambda peer: True)
    assert missing_note() == ""


def test_the_optimum_that_may_graze_corners_by_hand() -> None:
    grid = drawn(
        ".#.",
        "...",
        ".#.",
    )
    assert cutting_length(grid, (0, 0), (0, 2)) == pytest.approx(2 * math.sqrt(2))
    assert float(grid.distance_to((0, 2))[0, 0]) == 4
    assert touches_corner(grid, np.array([[0, 0], [1, 1], [0, 2]]))
    assert not touches_corner(grid, np.array([[0, 0], [1, 0], [1, 1], [1, 2], [0, 2]]))


def test_a_path_that_cuts_corners_is_measured_by_its_own_optimum() -> None:
    class Cutting(Broken):
        cuts_corners = True

    name = "clutter20"
    (task,) = make_tasks(name, 1, 0)
    grid = make_map(name)
    path = shortest_cutting(grid, task.start, task.goal)
    row = measure(name, Cutting(), task, Plan(path, np.empty(0), 0.001), 0.001)
    assert row["gap"] == pytest.approx(0)
    assert row["min_turns"] is None
    assert row["optimal_length"] <= task.optimal_length
    assert (row["clearance"] == 0) == touches_corner(grid, path)
    with pytest.raises(PlanError, match="jumps"):
        measure(name, Cutting(), task, Plan(path[[0, -1]], np.empty(0), 0.001), 0.001)


def shortest_cutting(grid: GridMap, start: Cell, goal: Cell) -> np.ndarray:
    """Descend the lengths to the goal, cell by cell."""
    path = [start]
    while path[-1] != goal:
        row, column = path[-1]
        around = [(row + r, column + c) for r in (-1, 0, 1) for c in (-1, 0, 1) if (r, c) != (0, 0)]
        rows, columns = grid.shape
        free = [c for c in around if 0 <= c[0] < rows and 0 <= c[1] < columns and not grid.occupied[c]]
        path.append(min(free, key=lambda c: math.dist(c, path[-1]) + cutting_length(grid, c, goal)))
    return np.array(path)
