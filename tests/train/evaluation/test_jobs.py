"""Test jobs: a lost process or node loses only its job, and all kinds of workers give the same rows."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from train.cli import LOST, main
from train.evaluation.cluster import Cluster, check_code, code_here
from train.evaluation.jobs import Here, Job, Numbered, Progress, Result, Runner, Tick, Workers
from train.evaluation.processes import Processes
from train.reporting.rows import Row, RowFile, read_rows
from warehouse_env.errors import LostError, WarehouseError

ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class Square(Job):
    """Job with two rows about a number; it kills its process while the file `kills` is missing."""

    number: int
    kills: Path | None = None

    titled = "square of {number}"

    @property
    def identity(self) -> Row:
        return {"kind": "square", "number": self.number}

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Square | None]:
        return (rows[:2], None) if len(rows) > 1 else ([], self)

    def run(self, tick: Tick) -> Result:
        if self.kills is not None and not self.kills.exists():
            with contextlib.suppress(OSError):  # in a missing folder the file never exists
                self.kills.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if self.number < 0:
            raise WarehouseError("nothing to square")
        tick(1.0)
        common = {**self.identity, "square": self.number**2}
        return Result([{**common, "part": part} for part in range(2)])


@dataclass(frozen=True)
class Sleep(Job):
    """Job that notes its process and outlasts every test."""

    folder: Path

    titled = "sleep"

    def run(self, tick: Tick) -> Result:
        (self.folder / str(os.getpid())).touch()
        time.sleep(600.0)
        return Result([])


def done(path: Path, jobs: Sequence[Job], workers: Workers | None = None) -> list[Row]:
    with RowFile(path, keep=True) as file, Runner(file, file.old(), workers, goes_on="again") as run:
        return run(jobs)


@pytest.fixture(params=["processes", "cluster"])
def make_workers(request: pytest.FixtureRequest) -> Callable[[], Workers]:
    """Return a factory of workers, for both kinds that can be lost."""
    if request.param == "processes":
        return lambda: Processes(2)
    address = request.getfixturevalue("connected_nodes").address
    return lambda: Cluster(address)


def test_killed_job_is_retried_or_named_and_others_are_kept(
    make_workers: Callable[[], Workers], tmp_path: Path
) -> None:
    never, once = tmp_path / "none" / "x", tmp_path / "once"
    jobs = [Square(number, {1: once, 2: never}.get(number)) for number in range(6)]
    with pytest.raises(LostError, match=r"1 of 6 jobs lost .* times: square of 2; 10 rows are kept in .*; again"):
        done(tmp_path / "rows.jsonl", jobs, make_workers())
    assert sorted(row["number"] for row in read_rows(tmp_path / "rows.jsonl")) == [0, 0, 1, 1, 3, 3, 4, 4, 5, 5]
    jobs[2] = Square(2)
    assert [row["square"] for row in done(tmp_path / "rows.jsonl", jobs)] == [0, 0, 1, 1, 4, 4, 9, 9, 16, 16, 25, 25]


def test_job_errors_are_raised_unchanged(make_workers: Callable[[], Workers], tmp_path: Path) -> None:
    for workers in (Here(), make_workers()):
        with pytest.raises(WarehouseError, match="nothing to square"):
            done(tmp_path / "rows.jsonl", [Square(-1)], workers)


def test_jobs_return_only_their_own_rows(tmp_path: Path) -> None:
    done(tmp_path / "rows.jsonl", [Square(3), Square(4)])
    rows = done(tmp_path / "rows.jsonl", [Square(4), Square(5)])
    assert [row["square"] for row in rows] == [16, 16, 25, 25]


def test_processes_end_with_their_parent(tmp_path: Path) -> None:
    """SIGKILL leaves the parent no time to stop its processes."""
    body = (
        "import sys; from pathlib import Path; from tests.train.evaluation.test_jobs import Processes, Sleep, done\n"
        "if __name__ == '__main__': done(Path('rows.jsonl'), [Sleep(Path(sys.argv[1]))] * 2, Processes(2))"
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


def _wait_until(over: Callable[[], bool], seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while not over() and time.monotonic() < deadline:
        time.sleep(0.05)


def test_any_prefix_of_the_file_resumes_to_the_same_rows(tmp_path: Path) -> None:
    jobs = [Square(number) for number in range(3)]
    rows = done(tmp_path / "whole.jsonl", jobs)
    whole = (tmp_path / "whole.jsonl").read_bytes()
    for length in range(len(whole) + 1):
        path = tmp_path / "cut.jsonl"
        path.write_bytes(whole[:length])
        assert done(path, jobs) == rows
        written = read_rows(path)
        assert [row for k, row in enumerate(written) if row not in written[:k]] == rows


DRIVE = ("evaluate", "--policy", "greedy", "follow", "--robots", "4", "--layout", "open", "--planner", "astar",
         "--episodes", "5", "--seconds", "10", "--no-pictures")  # fmt: skip


def driven(path: Path, *more: str) -> list[Row]:
    """Run DRIVE and return its sorted rows without times."""
    assert main([*DRIVE, "--out", str(path), *more]) == 0
    rows = [{k: value for k, value in row.items() if k != "ms_per_step"} for row in read_rows(path / "rows.jsonl")]
    return sorted(rows, key=lambda row: (row["policy"], row["episode"]))


def test_here_processes_and_nodes_give_the_same_rows(tmp_path: Path, connected_nodes: Any) -> None:
    here = driven(tmp_path / "here")
    assert len(here) == 10
    assert here == driven(tmp_path / "two", "--processes", "2")
    assert here == driven(tmp_path / "ray", "--ray", connected_nodes.address)
    assert {row["ms_per_step"] for row in read_rows(tmp_path / "ray" / "rows.jsonl")} == {None}


def test_node_with_other_code_is_refused() -> None:
    here = code_here()
    check_code(here, dict(here))
    with pytest.raises(WarehouseError, match=r"has numba 0\.1, sources 0123, here it is numba \d\S+, sources \w+"):
        check_code(here, here | {"sources": "0123", "numba": "0.1"})


@pytest.mark.nightly
def test_command_names_a_job_that_kills_its_worker(
    tmp_path: Path, connected_nodes: Any, registries: None, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """The policy's own file and the module beside it travel with the job."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beside.py").write_text("import os, signal\n")
    (tmp_path / "mine.py").write_text(
        "from beside import os, signal\n"
        "from agents.rules import Follow\n"
        "class Mine(Follow):\n"
        "    def act(self, observation, rng):\n"
        "        if observation.any(): os.kill(os.getpid(), signal.SIGKILL)\n"
        "        return super().act(observation, rng)\n"
    )
    own = [*DRIVE[:2], "mine.py:Mine", "follow", *DRIVE[4:], "--episodes", "1", "--out", "own"]
    assert main([*own, "--ray", connected_nodes.address]) == LOST
    assert "mine.py:Mine" in capsys.readouterr().err
    assert {row["policy"] for row in read_rows(tmp_path / "own" / "rows.jsonl")} == {"follow"}


@dataclass(frozen=True)
class Slow(Square):
    """Job that notes its start and takes half a second."""

    folder: str = ""

    def run(self, tick: Tick) -> Result:
        (Path(self.folder) / f"{self.number}-{os.getpid()}").touch()
        time.sleep(0.5)
        return super().run(tick)


@pytest.mark.nightly
def test_jobs_of_a_lost_node_are_retried(tmp_path: Path, connected_nodes: Any) -> None:
    third = connected_nodes.add_node(num_cpus=1)
    notes = tmp_path / "notes"
    notes.mkdir()
    jobs = [Slow(number, folder=str(notes)) for number in range(12)]

    class Removing(Cluster):
        """Cluster that loses a node after the third result."""

        def each(self, jobs: Sequence[Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
            for count, given in enumerate(super().each(jobs, moved), start=1):
                if count == 3:
                    time.sleep(0.2)  # the next jobs need time to start
                    connected_nodes.remove_node(third, allow_graceful=False)
                yield given

    rows = done(tmp_path / "rows.jsonl", jobs, workers=Removing(connected_nodes.address))
    assert [row["number"] for row in rows] == sorted(2 * list(range(12)))
    assert len(read_rows(tmp_path / "rows.jsonl")) == 24
    assert len(list(notes.iterdir())) > 12  # some jobs ran twice


@pytest.mark.nightly
def test_killed_driver_resumes(tmp_path: Path, connected_nodes: Any) -> None:
    command = [*DRIVE, "--out", "rows", "--ray", connected_nodes.address]
    path = tmp_path / "rows" / "rows.jsonl"
    with subprocess.Popen([sys.executable, "-m", "train.cli", *command], cwd=tmp_path) as driver:
        while driver.poll() is None and not (path.is_file() and path.read_text().count("\n") > 1):
            time.sleep(0.01)
        driver.send_signal(signal.SIGKILL)
    assert 0 < len(read_rows(path)) < 10
    assert driven(path.parent, "--ray", connected_nodes.address, "--resume") == driven(tmp_path / "here")
