"""Each thread has its scratch, and uses it again."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from warehouse_env.simulation.worlds import ThreadScratch


def test_a_thread_gets_its_own_scratch_again() -> None:
    scratch = ThreadScratch(list, list)  # type: ignore[arg-type]
    with ThreadPoolExecutor(1) as other:
        theirs = [other.submit(lambda: scratch.search).result() for _ in range(2)]
    assert theirs[0] is theirs[1]
    assert scratch.search is scratch.search
    assert scratch.search is not theirs[0]
