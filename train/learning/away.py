"""A training in a folder of another machine: its files come back as they change, so that it can go on anywhere."""

from __future__ import annotations

import contextlib
import importlib
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from train.job_files import JobFiles, unpacked
from train.learning.config import TrainingConfig
from train.learning.training_run import CHECKPOINT, LOCK
from train.own import Typed, take_in
from warehouse_env.files import complete_file

_LOOK = 0.5  # [s] between two looks at the folder
_STATE = f"{CHECKPOINT}/state.json"  # written last, so what it names is there


class Changes(NamedTuple):
    """What changed in the folder of a run."""

    names: tuple[str, ...]  # of all files, relative to the folder
    content: dict[str, bytes]  # of those that are new or changed


def content_of(folder: Path) -> dict[str, bytes]:
    """Return the files of a run, none where there is none."""
    return _changes(folder, {}).content if folder.is_dir() else {}


def write(folder: Path, changes: Changes) -> None:
    """Bring the folder of a run to where changes lead; whenever it is stopped, it holds a checkpoint to go on from."""
    for name in sorted(changes.content, key=lambda name: name == _STATE):
        with complete_file(folder / name) as part:
            part.write_bytes(changes.content[name])
    for path in (folder / CHECKPOINT).glob("*"):
        if path.relative_to(folder).as_posix() not in changes.names:
            path.unlink()


def train_away(
    module: str, config: TrainingConfig, content: dict[str, bytes], files: JobFiles, parts: list[Typed]
) -> Iterator[Changes]:
    """Train in a folder of this machine, or go on where the run has content; yield what changed at each checkpoint.

    module: with a function `train`. config: its folder is a relative path. files, parts: what floors are read from.
    """
    with tempfile.TemporaryDirectory(prefix="warehouse-") as home, contextlib.chdir(home), unpacked(files):
        take_in(parts)
        folder = config.directory
        write(folder, Changes(tuple(content), content))
        known = _stamps(folder)
        train = importlib.import_module(module).train
        going_on = type(config)(resume=folder, progress=False) if content else config
        failed: list[BaseException] = []

        def run() -> None:
            try:
                train(going_on)
            except BaseException as error:
                failed.append(error)

        training = threading.Thread(target=run, daemon=True)
        training.start()
        while training.is_alive():
            training.join(_LOOK)
            state = folder / _STATE
            if state.is_file() and known.get(_STATE) != _stamp(state):
                with contextlib.suppress(FileNotFoundError):  # the next checkpoint is on its way
                    changes = _changes(folder, known)
                    known = _stamps(folder)
                    yield changes
        if failed:
            raise failed[0]
        yield _changes(folder, {})


Stamp = tuple[int, int]


def _stamp(path: Path) -> Stamp:
    known = path.stat()
    return known.st_mtime_ns, known.st_size


def _stamps(folder: Path) -> dict[str, Stamp]:
    paths = (path for path in folder.rglob("*") if path.is_file() and path.name != LOCK)
    return {path.relative_to(folder).as_posix(): _stamp(path) for path in paths}


def _changes(folder: Path, known: dict[str, Stamp]) -> Changes:
    """Return what differs from `known`, read while no checkpoint was written; FileNotFoundError if one was."""
    for _ in range(10):
        now = _stamps(folder)
        content = {name: (folder / name).read_bytes() for name, stamp in now.items() if known.get(name) != stamp}
        if _stamps(folder).get(_STATE) == now.get(_STATE):
            return Changes(tuple(now), content)
        time.sleep(_LOOK)
    raise FileNotFoundError(folder)
