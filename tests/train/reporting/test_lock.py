"""A lock is held by one, says by whom, and does not outlive its holder."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from train.reporting.rows import RowFile, held
from warehouse_env.errors import WarehouseError

ROOT = Path(__file__).parents[3]


def test_who_holds_it_is_said_and_nothing_is_left(tmp_path: Path) -> None:
    lock = tmp_path / "new" / ".lock"
    with held(lock, tmp_path):
        with pytest.raises(WarehouseError, match=rf"{tmp_path} is in use by process {os.getpid()}, since 2\d\d\d-"):
            held(lock, tmp_path).__enter__()
        assert lock.exists()  # which the other one left alone
    assert not lock.exists()
    assert not lock.parent.exists()
    with held(lock, tmp_path):
        (tmp_path / "new" / "file").touch()
    assert [path.name for path in lock.parent.iterdir()] == ["file"]


def test_a_file_of_rows_has_one_writer(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    with RowFile(path), pytest.raises(WarehouseError, match=rf"{path} is in use by process {os.getpid()}, since"):
        RowFile(path, keep=True).__enter__()


def test_a_killed_process_holds_nothing(tmp_path: Path) -> None:
    lock = tmp_path / ".lock"
    body = "import os, sys; from pathlib import Path; from train.reporting.rows import held\n"
    body += "with held(Path(sys.argv[1]), Path('it')): os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", body, lock], cwd=ROOT, check=False)
    assert lock.exists()
    with held(lock, tmp_path):
        assert lock.read_text().startswith(f"process {os.getpid()},")


def test_a_file_system_without_locks_is_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", refuse)
    with RowFile(tmp_path / "rows.jsonl") as file:
        file.add([{"a": 1}])
    assert (tmp_path / "rows.jsonl").read_text() == '{"a": 1}\n'
