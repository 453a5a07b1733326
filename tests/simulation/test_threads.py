"""Parts done side by side: each once, on several threads, whatever becomes of the helpers."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from warehouse_env.simulation import threads
from warehouse_env.simulation.threads import side_by_side

ROOT = Path(__file__).parents[2]


def test_every_part_is_done_once() -> None:
    done: list[int] = []

    def call(part: int) -> int:
        done.append(part)
        return part * part

    for count in (1, 2, 50):
        done.clear()
        results = side_by_side(call, [(part,) for part in range(count)], 3)
        assert sorted(results) == [part * part for part in range(count)]
        assert sorted(done) == list(range(count))


def test_parts_run_at_the_same_time() -> None:
    meet = threading.Barrier(3, timeout=60)  # broken unless three threads are in it at once
    assert len(set(side_by_side(lambda _: meet.wait() and threading.get_ident(), [(k,) for k in range(3)], 3))) == 3


def test_one_thread_is_the_callers_own() -> None:
    here = threading.get_ident()
    assert side_by_side(lambda _: threading.get_ident(), [(k,) for k in range(5)], 1) == [here] * 5


def test_an_error_comes_when_all_parts_are_over() -> None:
    over: list[int] = []

    def call(part: int) -> None:
        over.append(part)
        if part == 1:
            raise ValueError("part 1")

    with pytest.raises(ValueError, match="part 1"):
        side_by_side(call, [(part,) for part in range(9)], 2)
    assert sorted(over) == list(range(9))


def test_helpers_that_get_no_core_hold_nobody_up() -> None:
    side_by_side(time.sleep, [(0.01,)] * 2, 2)
    release = threading.Event()
    try:
        for _ in threads._helpers:
            threads._jobs.put(lambda: release.wait(60) and None)
        here = threading.get_ident()
        assert side_by_side(lambda _: threading.get_ident(), [(k,) for k in range(9)], 2) == [here] * 9
    finally:
        release.set()


FORKED = """
import os, sys
sys.path.insert(0, {root!r})
import numba
numba.set_num_threads(2)
from tests.simulation.test_determinism import ACTION_TYPES, MAP, drawn, run
def digests():
    return run(64, 5, 4, "raw", drawn(MAP))
here = digests()
child = os.fork()
if child == 0:
    os._exit(0 if digests() == here else 3)
print(os.waitpid(child, 0)[1], flush=True)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_process_steps_on() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", FORKED.format(root=str(ROOT))],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.stdout.strip() == "0", done.stderr
