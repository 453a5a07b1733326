"""`warehouse live`: it says where it is, ends by Ctrl-C with one sentence, and refuses what cannot be."""

from __future__ import annotations

import signal
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

from train.cli import STOPPED
from train.reporting.rows import read_rows

LIVE = "live --layout open --policy greedy --planner astar_turns --robots 4 --seed 7"


def _take_ctrl_c() -> None:
    """Let SIGINT reach a child process, even if its parent ignores it, as in the background of a shell."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_ends_it_with_one_sentence(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "train.cli", *LIVE.split(), "--json", str(tmp_path / "live.jsonl")]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, preexec_fn=_take_ctrl_c, **pipes) as running:
        try:
            assert running.stdout is not None
            address = running.stdout.readline().split()[4]
            assert address.startswith("http://127.0.0.1:")
            with urllib.request.urlopen(address, timeout=60) as page:
                assert b"<title>Live warehouse</title>" in page.read()
            with urllib.request.urlopen(f"{address}states", timeout=600) as stream:
                length = bytes(4)
                while length == bytes(4):  # the world is being made
                    length = stream.read(4)
            assert length, "the stream ended before the first state"
            running.send_signal(signal.SIGINT)
            _, errors = running.communicate(timeout=60)
        finally:
            running.kill()  # otherwise Popen waits for it
    assert running.returncode == STOPPED
    assert errors.startswith("warehouse: stopped; the last world ran for ")
    assert errors.count("\n") == 1
    (row,) = read_rows(tmp_path / "live.jsonl")
    assert (row["policy"], row["floor"], row["robots"], row["seed"]) == ("greedy", "open", 4, 7)
    assert len(row["digest"]) == 32
