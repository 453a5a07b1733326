"""The measure of difference by hand, the varied choice, and penalised search."""

from __future__ import annotations

import numpy as np
import pytest

from warehouse_env.errors import ConfigError
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import make_planner, path_length, validate
from warehouse_env.traffic.alternatives import differences, penalty_routes, varied
from warehouse_env.traffic.conflicts import Route

SHAPE = (3, 4)


def route(*cells: tuple[int, int]) -> Route:
    return np.array(cells, dtype=np.int64)


TOP = route((0, 0), (0, 1), (0, 2), (0, 3))
DIP = route((0, 0), (1, 1), (1, 2), (0, 3))
LOW = route((0, 0), (1, 0), (2, 1), (2, 2), (1, 3), (0, 3))


def test_differences_by_hand() -> None:
    # TOP and DIP share 2 of 6 cells, TOP and LOW 2 of 8, DIP and LOW 2 of 8.
    expected = np.array([[0, 2 / 3, 3 / 4], [2 / 3, 0, 3 / 4], [3 / 4, 3 / 4, 0]])
    np.testing.assert_allclose(differences([TOP, DIP, LOW], SHAPE), expected, atol=1e-12)


def test_the_varied_choice_begins_with_the_cheapest_and_goes_far() -> None:
    routes, cost = [DIP, LOW, TOP], np.array([3.8, 5.8, 3.0])
    assert varied(routes, cost, SHAPE, 3, slack=1.0) == [2, 1, 0]
    assert varied(routes, cost, SHAPE, 3, slack=0.3) == [2, 0]
    assert varied(routes, cost, SHAPE, 1, slack=1.0) == [2]
    assert varied([TOP, TOP], np.array([3.0, 3.0]), SHAPE, 2, slack=0.0) == [0]
    with pytest.raises(ConfigError, match="slack"):
        varied(routes, cost, SHAPE, 2, slack=-0.1)


def test_penalised_search_finds_different_short_routes() -> None:
    grid, rng = make_layout("paper46"), np.random.default_rng(0)
    found = penalty_routes(make_planner("astar"), grid, (4, 3), (41, 42), 6, rng)
    assert len(found) == 6
    optimum = float(grid.distance_to((41, 42))[4, 3])
    assert path_length(found[0]) == pytest.approx(optimum)
    for path in found:
        validate(grid, path, (4, 3), (41, 42))
        assert path_length(path) <= 1.1 * optimum + 1e-9
    apart = differences(found, grid.shape)
    assert apart[~np.eye(6, dtype=bool)].min() > 0.3
