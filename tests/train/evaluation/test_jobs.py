"""Jobs: nothing that ends a process loses more than the job it was at, and none is waited for in vain."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from train.evaluation.jobs import Job, Result, Runner, Tick, Workers
from train.evaluation.processes import Processes
from train.reporting.rows import Row, RowFile, read_rows
from warehouse_env.errors import LostError

ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class Square(Job):
    """Two rows about a number; `kills` ends its process, while the file that it names is not there."""

    number: int
    kills: Path | None = None

    titled = "square of {number}"

    @property
    def identity(self) -> Row:
        return {"number": self.number}

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Square | None]:
        return (rows[:2], None) if len(rows) > 1 else ([], self)

    def run(self, tick: Tick) -> Result:
        if self.kills is not None and not self.kills.exists():
            with contextlib.suppress(OSError):  # where there is no such folder it is never there
                self.kills.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        tick(1.0)
        return Result([{"number": self.number, "part": part, "square": self.number**2} for part in range(2)])


@dataclass(frozen=True)
class Sleep(Job):
    """Notes its process, and takes longer than any test."""

    folder: Path

    titled = "sleep"

    def run(self, tick: Tick) -> Result:
        (self.folder / str(os.getpid())).touch()
        time.sleep(600.0)
        return Result([])


def done(path: Path, jobs: Sequence[Job], processes: int = 1, workers: Workers | None = None) -> list[Row]:
    workers = workers or (Processes(processes) if processes > 1 else None)
    with RowFile(path, keep=True) as file, Runner(file, file.old(), workers, goes_on="again") as run:
        return run(jobs)


def test_a_job_that_kills_its_process_is_named_and_all_others_are_kept(tmp_path: Path) -> None:
    jobs = [Square(number, tmp_path / "none" / "x" if number == 2 else None) for number in range(6)]
    with pytest.raises(LostError, match=r"1 of 6 jobs killed .*: square of 2; 10 rows are kept in .*; again"):
        done(tmp_path / "rows.jsonl", jobs, 2)
    assert sorted(row["number"] for row in read_rows(tmp_path / "rows.jsonl")) == [0, 0, 1, 1, 3, 3, 4, 4, 5, 5]
    jobs[2] = Square(2)
    assert [row["square"] for row in done(tmp_path / "rows.jsonl", jobs)] == [0, 0, 1, 1, 4, 4, 9, 9, 16, 16, 25, 25]


def test_a_job_that_was_killed_once_is_done_again(tmp_path: Path) -> None:
    jobs = [Square(number, tmp_path / "once" if number == 1 else None) for number in range(4)]
    rows = done(tmp_path / "rows.jsonl", jobs, 2)
    assert rows == done(tmp_path / "other.jsonl", jobs)
    assert len(read_rows(tmp_path / "rows.jsonl")) == 8


def test_processes_end_with_the_one_that_began_them(tmp_path: Path) -> None:
    """Killed hard, it can tell them nothing."""
    body = (
        "import sys; from pathlib import Path; from tests.train.evaluation.test_jobs import Sleep, done\n"
        "if __name__ == '__main__': done(Path('rows.jsonl'), [Sleep(Path(sys.argv[1]))] * 2, 2)"
    )
    (tmp_path / "begin.py").write_text(body)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "begin.py", str(tmp_path)]
    with subprocess.Popen(command, cwd=tmp_path, env=environment) as process:
        _wait_until(lambda: len(_noted(tmp_path)) == 2 or process.poll() is not None, 60.0)
        process.kill()
    processes = _noted(tmp_path)
    assert len(processes) == 2
    _wait_until(lambda: not any(map(_lives, processes)), 20.0)
    assert not any(map(_lives, processes))


def _noted(folder: Path) -> list[int]:
    return [int(path.name) for path in folder.iterdir() if path.name.isdecimal()]


def _lives(process: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False


def _wait_until(over: object, seconds: float) -> None:
    assert callable(over)
    deadline = time.monotonic() + seconds
    while not over() and time.monotonic() < deadline:
        time.sleep(0.05)


def test_any_prefix_of_the_file_comes_to_the_same_rows(tmp_path: Path) -> None:
    jobs = [Square(number) for number in range(3)]
    rows = done(tmp_path / "whole.jsonl", jobs)
    whole = (tmp_path / "whole.jsonl").read_bytes()
    for length in range(len(whole) + 1):
        path = tmp_path / "cut.jsonl"
        path.write_bytes(whole[:length])
        assert done(path, jobs) == rows
        written = read_rows(path)
        assert [row for k, row in enumerate(written) if row not in written[:k]] == rows
