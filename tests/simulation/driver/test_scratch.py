"""Scratch is lent to one caller at a time, and used again."""

from __future__ import annotations

from typing import Any

import numpy as np

from warehouse_env.simulation.driver.scratch import make_search_scratch
from warehouse_env.simulation.worlds import Pool


def memory(arrays: Any) -> int:
    return arrays.nbytes if isinstance(arrays, np.ndarray) else sum(map(memory, arrays))


def test_two_callers_at_once_get_two_sets_and_the_next_one_gets_one_of_them() -> None:
    pool = Pool(lambda: make_search_scratch(3, 1, 32))
    one, other = pool.take(), pool.take()
    assert one.nodes.poses is not other.nodes.poses
    pool.give_back(one)
    assert pool.take() is one


def test_a_set_takes_about_a_megabyte_and_little_more_for_each_robot() -> None:
    small, large = memory(make_search_scratch(1, 0, 32)), memory(make_search_scratch(1001, 0, 32))
    assert small < 1.1e6
    assert large - small < 1e6
