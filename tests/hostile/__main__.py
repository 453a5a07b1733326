"""Try hostile inputs on all readers and constructors, by the million, and go on where it stopped.

    python -m tests.hostile --inputs 10000000 --keep results/hostile       # what `make hostile` does
    python -m tests.hostile --only episode --input 812 --seed 0            # that input again, with its traceback

Input K of a target is made from (seed, target, K) alone. Each works, or raises one of our errors with one sentence,
within LONGEST; else it is a failure, whose input and traceback are kept, the first SHOWN of a kind.
"""

from __future__ import annotations

import faulthandler
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import tyro  # noqa: E402

from tests.hostile.targets import TARGETS, warm  # noqa: E402
from tests.odd import works_or_says  # noqa: E402
from train.learning.progress import LINE_SECONDS  # noqa: E402
from train.reporting.report import make_progress, tell  # noqa: E402
from train.reporting.rows import write_text  # noqa: E402

LONGEST = 10.0  # [s] for an input
COMPILING = 300.0  # [s] for one that may compile a kernel first
LARGEST = 2e9  # [bytes] of address space beyond what is used at first
GROWTH = 300.0  # [MB] that the most memory ever used may be above that after the first round
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


class Hunt:
    """What was tried, and what failed, kept in a folder."""

    def __init__(self, keep: Path, seed: int, only: tuple[str, ...]) -> None:
        self._keep, self._seed, self._names = keep, seed, only
        self._path = keep / f"state-{seed}.json"
        kept = json.loads(self._path.read_text()) if self._path.exists() else {}
        self.done: Counter[str] = Counter(kept.get("done", {}))
        self.failures: Counter[str] = Counter(kept.get("failures", {}))

    def round(self, folder: Path, most: int) -> None:
        """Try a share of each target's inputs, `most` in all."""
        for name in self._names:
            each = min(TARGETS[name].each, most)
            most -= each
            for number in range(self.done[name], self.done[name] + each):
                trace = attempt(name, self._seed, number, folder)
                if trace is not None:
                    self._failed(name, number, trace)
            self.done[name] += each
        write_text(self._path, json.dumps({"done": self.done, "failures": self.failures}, indent=2) + "\n")

    def _failed(self, name: str, number: int, trace: str) -> None:
        kind = _kind(name, trace)
        self.failures[kind] += 1
        if self.failures[kind] <= SHOWN:
            again = f'python -m tests.hostile --only "{name}" --input {number} --seed {self._seed}'
            given = TARGETS[name].make(Random(f"{self._seed} {name} {number}"))
            text = f"{again}\n\n{trace}\n{given!r}\n".encode(errors="backslashreplace").decode()
            write_text(self._keep / f"failure-{name.replace(' ', '-')}-{number}.txt", text)


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


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def main(
    inputs: int = 10_000_000,
    seed: int = 0,
    keep: Path = Path("results/hostile"),
    only: tuple[str, ...] = tuple(TARGETS),
    input: int | None = None,
) -> None:
    """Try hostile inputs, and say how many and what failed.

    Args:
        inputs: how many in all, those of earlier calls with the same seed and folder counted.
        seed: of the inputs.
        keep: folder of what was done, and of failures.
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
            failures = _hunt(Hunt(keep, seed, only), inputs, folder)
    finally:
        shutil.rmtree(os.environ["WAREHOUSE_CACHE_DIR"])
    if failures:
        sys.exit(1)


def _hunt(hunt: Hunt, inputs: int, folder: Path) -> int:
    """Go on until so many inputs are tried; return how many kinds of failures there are."""
    begin, told, before = time.monotonic(), time.monotonic(), hunt.done.total()
    usual: float | None = None
    with make_progress() as progress:
        bar = progress.add_task("hostile inputs", total=inputs, completed=before)
        while (left := inputs - hunt.done.total()) > 0:
            hunt.round(folder, left)
            usual = usual or _peak()
            if _peak() > usual + GROWTH:
                sys.exit(f"memory has grown from {usual:.0f} to {_peak():.0f} MB; the last round is to blame")
            progress.update(bar, completed=hunt.done.total())
            if progress.disable and time.monotonic() - told > LINE_SECONDS:
                tell(f"{hunt.done.total():,} of {inputs:,} inputs, {len(hunt.failures)} kinds of failures")
                told = time.monotonic()
    rate = (hunt.done.total() - before) / max(time.monotonic() - begin, 1e-9)
    for name, count in hunt.done.items():
        print(f"{name}: {count:,}")
    print(f"{hunt.done.total():,} inputs, {rate:,.0f} a second, at most {_peak():.0f} MB")
    for kind, count in hunt.failures.items():
        print(f"{count} times {kind}")
    print(f"{len(hunt.failures) or 'no'} kinds of failures")
    return len(hunt.failures)


if __name__ == "__main__":
    tyro.cli(main)
