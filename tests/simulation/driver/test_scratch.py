"""Each thread has its scratch, and uses it again."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from warehouse_env.simulation.driver.scratch import make_search_scratch
from warehouse_env.simulation.worlds import ThreadScratch


def memory(arrays: Any) -> int:
    return arrays.nbytes if isinstance(arrays, np.ndarray) else sum(map(memory, arrays))


def test_a_thread_gets_its_own_scratch_again() -> None:
    scratch = ThreadScratch(list, list)  # type: ignore[arg-type]
    with ThreadPoolExecutor(1) as other:
        theirs = [other.submit(lambda: scratch.search).result() for _ in range(2)]
    assert theirs[0] is theirs[1]
    assert scratch.search is scratch.search
    assert scratch.search is not theirs[0]


def test_a_set_takes_about_a_megabyte_and_little_more_for_each_robot() -> None:
    small, large = memory(make_search_scratch(1, 0, 32)), memory(make_search_scratch(1001, 0, 32))
    assert small < 1.1e6
    assert large - small < 1e6
