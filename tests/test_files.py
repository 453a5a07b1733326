"""Files are whole or absent, and what a killed writer leaves is removed by the next one."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from warehouse_env.files import complete_file


def test_what_a_killed_writer_left_goes_and_what_others_write_stays(tmp_path: Path) -> None:
    with subprocess.Popen(["true"]) as gone:
        pass
    left, other = tmp_path / f".a-{gone.pid}-abc.txt", tmp_path / f".ab-{gone.pid}-abc.txt"
    alive, named = tmp_path / f".a-{os.getppid()}-abc.txt", tmp_path / ".a-note-abc.txt"
    for path in (left, other, alive, named):
        path.touch()
    with complete_file(tmp_path / "a.txt") as part:
        part.write_text("new")
    assert {path.name for path in tmp_path.iterdir()} == {"a.txt", other.name, alive.name, named.name}
