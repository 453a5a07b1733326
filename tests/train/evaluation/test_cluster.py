"""Jobs on a Ray cluster: the same rows as anywhere else, whatever is lost on the way."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.train.evaluation.test_jobs import Square, done
from train.cli import LOST, main
from train.evaluation.cluster import Cluster
from train.evaluation.jobs import Job, Result, Tick
from train.evaluation.nodes import Node, about_this_node, check_nodes
from train.reporting.rows import Row, read_rows
from warehouse_env.errors import LostError, WarehouseError

pytest.importorskip("ray")
pytestmark = pytest.mark.xdist_group("ray")  # one cluster for all of them

DRIVE = ("evaluate", "--policy", "greedy", "follow", "--robots", "4", "--layout", "open", "--planner", "astar",
         "--episodes", "6", "--seconds", "20", "--no-pictures")  # fmt: skip


@dataclass(frozen=True)
class Slow(Square):
    """Notes that it began, and takes a while."""

    folder: str = ""

    def run(self, tick: Tick) -> Result:
        (Path(self.folder) / f"{self.number}-{os.getpid()}").touch()
        time.sleep(0.5)
        return super().run(tick)


def rows_of(path: Path) -> list[Row]:
    """Return rows without times, sorted."""
    kept = [{name: value for name, value in row.items() if name != "ms_per_step"} for row in read_rows(path)]
    return sorted(kept, key=lambda row: json.dumps([row["policy"], row["episode"]]))


def test_rows_are_the_same_here_in_processes_and_on_two_nodes(tmp_path: Path, two_nodes: Any) -> None:
    for name, more in (("here", ()), ("two", ("--processes", "2")), ("ray", ("--ray", two_nodes.address))):
        assert main([*DRIVE, "--out", str(tmp_path / name), *more]) == 0
    here, two, ray = (rows_of(tmp_path / name / "rows.jsonl") for name in ("here", "two", "ray"))
    assert len(here) == 12
    assert here == two == ray
    assert {row["ms_per_step"] for row in read_rows(tmp_path / "ray" / "rows.jsonl")} == {None}


def test_a_worker_that_is_killed_costs_nothing_but_time(tmp_path: Path, two_nodes: Any) -> None:
    jobs = [Square(number, tmp_path / "once" if number == 1 else None) for number in range(4)]
    rows = done(tmp_path / "rows.jsonl", jobs, workers=Cluster(two_nodes.address))
    assert rows == done(tmp_path / "other.jsonl", jobs)
    assert len(read_rows(tmp_path / "rows.jsonl")) == 8


def test_a_job_that_kills_each_worker_loses_only_itself(tmp_path: Path, two_nodes: Any) -> None:
    jobs = [Square(number, tmp_path / "none" / "x" if number == 2 else None) for number in range(6)]
    with pytest.raises(
        LostError, match=r"1 of 6 jobs were lost .* 4 times: square of 2; 10 rows are kept in .*; again"
    ):
        done(tmp_path / "rows.jsonl", jobs, workers=Cluster(two_nodes.address))
    assert sorted(row["number"] for row in read_rows(tmp_path / "rows.jsonl")) == [0, 0, 1, 1, 3, 3, 4, 4, 5, 5]


def test_a_node_that_goes_without_a_word(tmp_path: Path, two_nodes: Any) -> None:
    third = two_nodes.add_node(num_cpus=1)
    notes = tmp_path / "notes"
    notes.mkdir()
    jobs = [Slow(number, folder=str(notes)) for number in range(12)]

    @dataclass
    class Removing(Cluster):
        """Has a node removed when the third result is in."""

        def each(self, jobs: Sequence[Any], moved: Any) -> Any:
            for count, given in enumerate(Cluster.each(self, jobs, moved)):
                if count == 2:
                    time.sleep(0.2)  # until the next jobs have begun
                    two_nodes.remove_node(third, allow_graceful=False)
                yield given

    workers = Removing.__new__(Removing)
    Cluster.__init__(workers, two_nodes.address)
    rows = done(tmp_path / "rows.jsonl", jobs, workers=workers)
    assert [row["number"] for row in rows] == sorted(2 * list(range(12)))
    assert len(read_rows(tmp_path / "rows.jsonl")) == 24
    assert len(list(notes.iterdir())) > 12  # some of them twice


def test_a_driver_that_is_killed_goes_on(tmp_path: Path, two_nodes: Any) -> None:
    command = [*DRIVE, "--out", "rows", "--ray", two_nodes.address]
    path = tmp_path / "rows" / "rows.jsonl"
    with subprocess.Popen([sys.executable, "-m", "train.cli", *command], cwd=tmp_path) as driver:
        while driver.poll() is None and not (path.is_file() and path.read_text().count("\n") > 1):
            time.sleep(0.01)
        driver.send_signal(signal.SIGKILL)
    assert 0 < len(read_rows(path)) < 12
    with contextlib.chdir(tmp_path):
        assert main([*command, "--resume"]) == 0
        assert main([*DRIVE, "--out", "here"]) == 0
    assert rows_of(path) == rows_of(tmp_path / "here" / "rows.jsonl")


def test_errors_of_a_job_are_said_as_they_are(tmp_path: Path, two_nodes: Any) -> None:
    with pytest.raises(WarehouseError, match="nothing to square"):
        done(tmp_path / "rows.jsonl", [Wrong()], workers=Cluster(two_nodes.address))


class Wrong(Job):
    titled = "wrong"

    def run(self, tick: Tick) -> Result:
        raise WarehouseError("nothing to square")


def test_a_lost_job_is_an_exit_code(tmp_path: Path, two_nodes: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "train.py").write_text("raise SystemExit('my own training starts')\n")
    (tmp_path / "beside.py").write_text("import os, signal\n")
    (tmp_path / "mine.py").write_text(
        "from beside import os, signal\n"
        "from agents.path_following import Follow\n"
        "class Mine(Follow):\n"
        "    def act(self, observation, rng):\n"
        "        if observation.any(): os.kill(os.getpid(), signal.SIGKILL)\n"
        "        return super().act(observation, rng)\n"
    )
    own = ["evaluate", "--policy", "mine.py:Mine", "follow", *DRIVE[4:], "--episodes", "2", "--out", "own"]
    body = f"import sys; from train.cli import main; sys.exit(main({[*own, '--ray', two_nodes.address]!r}))"
    run = subprocess.run([sys.executable, "-P", "-c", body], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == LOST, run.stderr
    assert "mine.py:Mine" in run.stderr
    assert {row["policy"] for row in read_rows(tmp_path / "own" / "rows.jsonl")} == {"follow"}


def test_a_cluster_of_this_machine_leaves_nothing_behind(tmp_path: Path) -> None:
    home, work = tmp_path / "home", Path(tempfile.mkdtemp(prefix="t-"))
    home.mkdir()
    settings = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
    environment = {**settings, "HOME": str(home), "TMPDIR": str(work)}
    command = [*DRIVE[:6], "--layout", "open", "--planner", "astar", "--episodes", "1", "--seconds", "5",
               "--no-pictures", "--out", str(tmp_path / "rows"), "--ray", "local"]  # fmt: skip
    run = subprocess.run(
        [sys.executable, "-m", "train.cli", *command], cwd=tmp_path, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert "1 node with" in run.stderr
    assert not [path for path in home.rglob("*") if "ray" in path.name]
    work.rmdir()  # which is empty


def test_a_node_with_other_code_is_an_error_with_another_processor_a_note() -> None:
    here = about_this_node()
    assert list(check_nodes(here, {"a": here})) == []
    (note,) = check_nodes(here, {"10.0.0.2": here._replace(processor="abacus")})
    assert note.startswith("node 10.0.0.2 has another processor (abacus, here ")
    with pytest.raises(WarehouseError, match=r"node b has sources 0123, here it is \w+: install the same on both"):
        list(check_nodes(here, {"a": here, "b": here._replace(source="0123")}))
    older = tuple((name, "0.1" if name == "numba" else version) for name, version in here.versions)
    with pytest.raises(WarehouseError, match=r"node b has numba 0\.1, here it is numba \d"):
        list(check_nodes(here, {"b": Node("other", older, here.processor)}))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--ray", "auto", "--processes", "2"), "--processes 2 must be left out with --ray"),
        (("--ray", "somewhere"), "--ray 'somewhere' must be auto, local or HOST:PORT"),
        (("--shard", "4/3"), "--shard '4/3' must be I/N with I from 1 to N"),
    ],
)
def test_wrong_options_are_said_in_one_sentence(
    options: Sequence[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*DRIVE, "--out", str(tmp_path), *options]) == 2
    assert sentence in capsys.readouterr().err


def test_shares_together_are_all_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rows"
    assert main([*DRIVE, "--out", str(tmp_path / "here")]) == 0
    for share in range(1, 4):
        assert main([*DRIVE, "--out", str(out), "--shard", f"{share}/3"]) == 0
    assert "rows-*-of-3.jsonl" in capsys.readouterr().out
    parts = sorted(out.glob("rows-*-of-3.jsonl"))
    assert [len(read_rows(part)) > 0 for part in parts] == [True] * 3
    (out / "rows.jsonl").write_text("".join(part.read_text() for part in parts))
    before = (out / "rows.jsonl").read_text()
    assert main([*DRIVE, "--out", str(out), "--resume"]) == 0
    assert (out / "rows.jsonl").read_text() == before  # nothing was left to be driven
    assert rows_of(out / "rows.jsonl") == rows_of(tmp_path / "here" / "rows.jsonl")
