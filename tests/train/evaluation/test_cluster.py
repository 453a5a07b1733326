"""A Ray cluster that loses what it can: a node, the command itself, the process under a policy of one's own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.train.evaluation.test_jobs import DRIVE, Square, done, driven
from train.cli import LOST, main
from train.evaluation.cluster import Cluster
from train.evaluation.jobs import Numbered, Progress, Result, Tick
from train.reporting.rows import read_rows

pytest.importorskip("ray")


@pytest.mark.nightly
def test_a_job_that_kills_its_worker_is_named_by_the_command(
    tmp_path: Path, connected_nodes: Any, registries: None, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """The policy's own file and the module beside it travel with the job."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beside.py").write_text("import os, signal\n")
    (tmp_path / "mine.py").write_text(
        "from beside import os, signal\n"
        "from agents.path_following import Follow\n"
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
    """Notes that it began, and takes a while."""

    folder: str = ""

    def run(self, tick: Tick) -> Result:
        (Path(self.folder) / f"{self.number}-{os.getpid()}").touch()
        time.sleep(0.5)
        return super().run(tick)


@pytest.mark.nightly
def test_a_node_that_goes_without_a_word(tmp_path: Path, connected_nodes: Any) -> None:
    third = connected_nodes.add_node(num_cpus=1)
    notes = tmp_path / "notes"
    notes.mkdir()
    jobs = [Slow(number, folder=str(notes)) for number in range(12)]

    class Removing(Cluster):
        """Has a node removed when the third result is in."""

        def each(self, jobs: Sequence[Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
            for count, given in enumerate(super().each(jobs, moved), start=1):
                if count == 3:
                    time.sleep(0.2)  # until the next jobs have begun
                    connected_nodes.remove_node(third, allow_graceful=False)
                yield given

    rows = done(tmp_path / "rows.jsonl", jobs, workers=Removing(connected_nodes.address))
    assert [row["number"] for row in rows] == sorted(2 * list(range(12)))
    assert len(read_rows(tmp_path / "rows.jsonl")) == 24
    assert len(list(notes.iterdir())) > 12  # some of them twice


@pytest.mark.nightly
def test_a_driver_that_is_killed_goes_on(tmp_path: Path, connected_nodes: Any) -> None:
    command = [*DRIVE, "--out", "rows", "--ray", connected_nodes.address]
    path = tmp_path / "rows" / "rows.jsonl"
    with subprocess.Popen([sys.executable, "-m", "train.cli", *command], cwd=tmp_path) as driver:
        while driver.poll() is None and not (path.is_file() and path.read_text().count("\n") > 1):
            time.sleep(0.01)
        driver.send_signal(signal.SIGKILL)
    assert 0 < len(read_rows(path)) < 10
    assert driven(path.parent, "--ray", connected_nodes.address, "--resume") == driven(tmp_path / "here")
