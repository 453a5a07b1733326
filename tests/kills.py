"""Kill and resume commands at random moments, and compare their files with those of undisturbed runs.

    python -m tests.kills --kills 1000      # what `make kills` does

A command runs in a fork of this process, which has loaded all imports, so kills hit its work. SIGKILL ends its process
group after a time drawn evenly from its usual duration. The command then resumes as a user would resume it. Once it
finishes, its files are compared with those of an undisturbed run, except times and TensorBoard's log, which has a
file for each start.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
os.environ["MPLBACKEND"] = "Agg"

import tyro  # noqa: E402

from train.cli import main as warehouse  # noqa: E402
from train.reporting.report import make_progress  # noqa: E402
from train.reporting.rows import read_rows  # noqa: E402

LONGEST = 120.0  # [s] after which a command counts as hanging
TIMES = {"ms", "cpu_ms", "ms_per_step", "seconds", "plan_seconds", "steps_per_second", "last_figures"}
UNEQUAL = {".md", ".csv", ".html", ".png"}  # contain times, so only their presence is checked
_FLOOR = "--layout open --robots 3 --planner astar"
COMMANDS = {
    "train": (
        "train reinforce --name run --out . --no-progress --layouts open --robots 2 4 --rows 8 --planner astar "
        "--rollout 6 --minibatch 24 --hidden 24 --episode-seconds 3 --checkpoint-seconds 0.02 --threads 1 --steps 7200"
    ),
    "evaluate": (
        f"evaluate --policy brake follow ppo greedy {_FLOOR} --episodes 3 --seconds 10 --out . --report report "
        "--no-pictures --resume"
    ),
    "record": f"record --policy ppo {_FLOOR} --seconds 100 --out episode.npz",
    "tables": "tables papers --papers 000 --runs 1 --processes 1 --out . --json rows.jsonl --resume",
}


class KilledCommand:
    """A command in its own folder, and the files that it must produce."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.kills, self.rounds = name, 0, 0
        self._folder, self._log = folder / name, folder / f"{name}.log"
        self._begin()
        for _ in range(2):  # the first run compiles
            begun = time.monotonic()
            self._run(LONGEST)
            self._usual, self._wanted = time.monotonic() - begun, content(self._folder)
            self._begin()

    def _begin(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir(parents=True)

    def disturb(self, rng: random.Random) -> None:
        """Run the command and kill it, unless it finishes first."""
        if self._run(rng.uniform(0.0, 1.1 * self._usual)):
            self.kills += 1
        else:
            self._check()

    def finish(self) -> None:
        """Run the command to its end."""
        if self._run(LONGEST):
            sys.exit(f"{self.name} does not come to an end: {self._folder} is as it left it")
        self._check()

    def _check(self) -> None:
        """Compare the files with those of the undisturbed run and start over."""
        found = content(self._folder)
        wrong = [file for file in sorted({*found, *self._wanted}) if found.get(file) != self._wanted.get(file)]
        if wrong:
            sys.exit(f"{self.name} came to other files after kills: {', '.join(wrong)}; see {self._folder}")
        self._begin()
        self.rounds += 1

    def _run(self, seconds: float) -> bool:
        """Start or resume the command; kill it after `seconds`; return whether it was killed."""
        words = COMMANDS[self.name].split()
        if (self._folder / "run" / "checkpoint" / "state.json").exists():
            words = [*words[:2], "--resume", "run", "--no-progress"]
        process = os.fork()
        if not process:
            os.setsid()
            os.chdir(self._folder)
            log = os.open(self._log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(log, 1)
            os.dup2(log, 2)
            os._exit(warehouse(words))
        deadline = time.monotonic() + seconds
        while not (status := os.waitpid(process, os.WNOHANG))[0] and time.monotonic() < deadline:
            time.sleep(0.001)
        if not status[0]:
            _kill(process)
            status = os.waitpid(process, 0)
        code = os.waitstatus_to_exitcode(status[1])
        if code not in (0, -signal.SIGKILL):
            sys.exit(f"{self.name} ended with {code} in {self._folder}: {self._log.read_text()}")
        return code != 0


def _kill(process: int) -> None:
    try:
        os.killpg(process, signal.SIGKILL)
    except ProcessLookupError:  # it has no process group yet
        os.kill(process, signal.SIGKILL)


def content(folder: Path) -> dict[str, Any]:
    """Return the content of a folder's files by name, without times."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.parent.name != "tensorboard")
    return {str(path.relative_to(folder)): _content(path) for path in files}


def _content(path: Path) -> Any:
    if path.suffix in UNEQUAL:
        return None
    if path.name == "progress.jsonl":  # a row every few seconds, and one at the end
        return read_rows(path)[-1]["steps"]
    if path.suffix == ".jsonl":
        rows = sorted(json.dumps(_timeless(row), sort_keys=True) for row in read_rows(path))
        return sorted(set(rows)) if path.name == "places.jsonl" else rows
    if path.suffix == ".json":
        return _timeless(json.loads(path.read_text()))
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _timeless(value: Any) -> Any:
    if isinstance(value, list):
        return [_timeless(one) for one in value]
    if isinstance(value, dict):
        return {name: _timeless(one) for name, one in value.items() if name not in TIMES}
    return value


def main(kills: int = 1000, seed: int = 0, only: tuple[str, ...] = tuple(COMMANDS)) -> None:
    """Kill commands at random moments and check their final files.

    Args:
        kills: number of kills over all commands.
        seed: seed of the moments, which also depend on the clock.
        only: the commands to kill.
    """
    importlib.import_module("train.trainers")
    rng, folder = random.Random(seed), Path(tempfile.mkdtemp(prefix="warehouse-kills-"))
    os.environ["WAREHOUSE_CACHE_DIR"] = str(folder / "cache")
    trials = [KilledCommand(name, folder) for name in only]
    with make_progress() as progress:
        bar = progress.add_task("kills", total=kills)
        while (done := sum(trial.kills for trial in trials)) < kills:
            progress.update(bar, completed=done)
            min(trials, key=lambda trial: trial.kills).disturb(rng)
    for trial in trials:
        trial.finish()
        print(f"{trial.name}: {trial.kills} kills, {trial.rounds} times to the same files as undisturbed")
    shutil.rmtree(folder)


if __name__ == "__main__":
    tyro.cli(main)
