"""Try hostile inputs on all readers and constructors.

    python -m tests.hostile --inputs 10000000 --seed 3                     # what `make hostile` does
    python -m tests.hostile --only episode --input 812 --seed 0            # that input again, with its traceback

Input K of a target is made from (seed, target, K) alone. Each works, or raises one of our errors with one sentence,
within LONGEST; otherwise it is a failure. The first SHOWN of a kind are printed, with the command that tries it again.
"""

from __future__ import annotations

import faulthandler
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import tyro

from tests.hostile.targets import TARGETS, warm
from tests.odd import works_or_says
from train.reporting.report import make_progress

LONGEST = 10.0  # [s] for an input
COMPILING = 300.0  # [s] for one that may compile a kernel first
LARGEST = 2e9  # [bytes] of address space beyond what is used at first
SHOWN = 3


class HangError(BaseException):
    """An input that takes too long; no Exception, so that nobody takes it for damage."""


def attempt(name: str, seed: int, number: int, folder: Path) -> str | None:
    """Try one input of a target; return the traceback of a failure.

    One that takes too long is tried again, with time to compile, and then once more: it may have met a kernel first.
    """
    trace = None
    for seconds in (LONGEST, COMPILING, LONGEST):
        target = TARGETS[name]
        given = target.make(Random(f"{seed} {name} {number}"))
        signal.setitimer(signal.ITIMER_REAL, seconds)
        try:
            works_or_says(lambda target=target, given=given: target.take(given, folder))
            return None
        except Exception:
            return traceback.format_exc()
        except HangError:
            trace = traceback.format_exc()
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            _clear(folder)
    return trace


def _clear(folder: Path) -> None:
    for entry in os.scandir(folder):
        if entry.is_dir(follow_symlinks=False):
            shutil.rmtree(entry)
        else:
            os.unlink(entry)


def _kind(name: str, trace: str) -> str:
    """Return what failures have in common that are shown a few times only: target, error and the last line of ours."""
    lines = trace.rstrip().splitlines()
    ours = [line.strip() for line in lines if line.startswith("  File") and "site-packages" not in line]
    return f"{name}: {lines[-1].split(':')[0]} at {ours[-1] if ours else '?'}"


@contextmanager
def guarded() -> Iterator[Path]:
    """Lend a folder in memory; what hangs is stopped, and no input gets more than LARGEST of memory."""

    def stop(number: int, frame: object) -> None:
        raise HangError(f"more than {LONGEST:g} s")

    former = signal.signal(signal.SIGALRM, stop)
    limits = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (int(used + LARGEST), limits[1]))
    shared = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="warehouse-hostile-", dir=shared if os.access(shared, os.W_OK) else None))
    try:
        warm(folder)
        yield folder
    finally:
        shutil.rmtree(folder)
        resource.setrlimit(resource.RLIMIT_AS, limits)
        signal.signal(signal.SIGALRM, former)


def hunt(names: tuple[str, ...], seed: int, inputs: int, folder: Path) -> Counter[str]:
    """Try so many inputs in all, in rounds over the targets; return how many failed, by kind."""
    done, failures = Counter[str](), Counter[str]()
    with make_progress() as progress:
        bar = progress.add_task("hostile inputs", total=inputs)
        while done.total() < inputs:
            for name in names:
                each = min(TARGETS[name].each, inputs - done.total())
                for number in range(done[name], done[name] + each):
                    trace = attempt(name, seed, number, folder)
                    if trace is None:
                        continue
                    failures[kind := _kind(name, trace)] += 1
                    if failures[kind] <= SHOWN:
                        print(f'{trace}\npython -m tests.hostile --only "{name}" --input {number} --seed {seed}\n')
                done[name] += each
            progress.update(bar, completed=done.total())
    return failures


def main(
    inputs: int = 10_000_000, seed: int = 0, only: tuple[str, ...] = tuple(TARGETS), input: int | None = None
) -> None:
    """Try hostile inputs, and say how many failed, and how.

    Args:
        inputs: how many in all.
        seed: of the inputs.
        only: targets to try.
        input: number of the one input to try, of the one target.
    """
    faulthandler.enable()
    os.environ["WAREHOUSE_CACHE_DIR"] = tempfile.mkdtemp(prefix="warehouse-hostile-")
    try:
        with guarded() as folder:
            if input is not None:
                print(attempt(only[0], seed, input, folder) or "it works, or one of our errors says what is wrong")
                return
            failures = hunt(only, seed, inputs, folder)
    finally:
        shutil.rmtree(os.environ["WAREHOUSE_CACHE_DIR"])
    for kind, count in failures.items():
        print(f"{count} times {kind}")
    print(f"{inputs:,} inputs, {len(failures) or 'no'} kinds of failures")
    sys.exit(bool(failures))


if __name__ == "__main__":
    tyro.cli(main)
