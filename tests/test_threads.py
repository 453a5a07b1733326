"""Test parallel parts: each runs once, on several threads, also after errors and interrupts."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from warehouse_env.errors import ConfigError
from warehouse_env.threads import get_num_threads, set_num_threads, side_by_side

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def three_threads() -> Iterator[None]:
    before = get_num_threads()
    set_num_threads(3)
    yield
    set_num_threads(before)


def test_every_part_runs_once() -> None:
    done: list[int] = []

    def call(part: int) -> int:
        done.append(part)
        return part * part

    for count in (1, 2, 50):
        done.clear()
        results = side_by_side(call, [(part,) for part in range(count)])
        assert sorted(results) == [part * part for part in range(count)]
        assert sorted(done) == list(range(count))


def test_parts_run_at_the_same_time() -> None:
    meet = threading.Barrier(3, timeout=60)  # breaks unless three threads wait at once
    assert len(set(side_by_side(lambda _: meet.wait() and threading.get_ident(), [(k,) for k in range(3)]))) == 3


def test_error_is_raised_after_all_parts() -> None:
    over: list[int] = []

    def call(part: int) -> None:
        over.append(part)
        if part == 1:
            raise ValueError("part 1")

    with pytest.raises(ValueError, match="part 1"):
        side_by_side(call, [(part,) for part in range(9)])
    assert sorted(over) == list(range(9))


@pytest.mark.skipif(threading.current_thread() is not threading.main_thread(), reason="only it is interrupted")
def test_interrupt_waits_for_running_parts() -> None:
    """Otherwise helpers would write into arrays that the caller already reuses."""
    here, meet, over = threading.get_ident(), threading.Barrier(2, timeout=60), []

    def call(part: int) -> None:
        if part < 2:
            meet.wait()
            if threading.get_ident() != here:
                time.sleep(0.2)  # until the caller has finished its part and waits
                signal.pthread_kill(here, signal.SIGINT)
                time.sleep(0.3)
        over.append(part)

    set_num_threads(2)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs of a shell ignore SIGINT
    try:
        with pytest.raises(KeyboardInterrupt):
            side_by_side(call, [(0,), (1,)])
    finally:
        signal.signal(signal.SIGINT, before)
    assert sorted(over) == [0, 1]


def test_each_thread_has_its_own_number() -> None:
    with ThreadPoolExecutor(1, initializer=set_num_threads, initargs=(7,)) as other:
        assert other.submit(get_num_threads).result() == 7
    assert get_num_threads() == 3
    for wrong in (0, -1, 1.5, True, "2", None):
        with pytest.raises(ConfigError, match="threads="):
            set_num_threads(wrong)  # type: ignore[arg-type]


FORKED = """
import os, sys
sys.path.insert(0, {root!r})
from warehouse_env.threads import set_num_threads
set_num_threads(2)
from tests.simulation.test_determinism import MAP, drawn, run
def digests():
    return run(64, 5, 4, "raw", drawn(MAP))
here = digests()
child = os.fork()
if child == 0:
    os._exit(0 if digests() == here else 3)
print(os.waitpid(child, 0)[1], flush=True)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_forked_process_can_step() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", FORKED.format(root=str(ROOT))],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.stdout.strip() == "0", done.stderr
