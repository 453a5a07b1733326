"""The files that a command's options name: no input is overwritten, and no two outputs are the same file."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from train.job_files import files_behind
from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.files import check_writable, guarded, is_special

OUTPUTS = {"json", "out", "html", "png", "video", "onnx", "report", "save", "resume"}
"""Options that name outputs; any other path is an input."""
_NAMED = {"draw", "layout", "layouts", "map", "planner", "policy", "sensor", "tasks"}  # text that may name files


@contextmanager
def checked(options: Any) -> Iterator[None]:
    """Guard the files of a command that runs within this context.

    ConfigError if two outputs name one file; WarehouseError if an output cannot or must not be written.
    """
    given = _given(options)
    rewrites = getattr(options, "rewrites", ())  # suffixes of inputs that the command may replace
    read = [path for name, value, _ in given if name not in OUTPUTS for path in _files(name, value)]
    with guarded(path for path in read if not path.name.endswith(rewrites)):
        taken: dict[str, str] = {}
        for name, path, is_folder in given:
            if name in OUTPUTS and isinstance(path, Path) and not is_folder:
                place = os.path.realpath(path)
                if place in taken and not is_special(path):
                    raise ConfigError(f"--{taken[place]} and --{name} name the same file {path}; name two")
                taken[place] = name
                check_writable(path, rows=name == "json")
        yield


def _given(options: Any) -> list[tuple[str, Any, bool]]:
    """Return (name, value, whether it is a folder) of all options, those of an inner `config` included."""
    found = []
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            found += _given(value)
            continue
        names_file = isinstance(field.default, Path) and field.default.suffix != ""
        found.append((field.name, value, field.name in ("out", "report", "resume") and not names_file))
    return found


def _files(name: str, value: Any) -> Iterator[Path]:
    """Yield the files that the value of an option names."""
    for one in value if isinstance(value, tuple) else (value,):
        if isinstance(one, Path) and one.is_dir():
            yield from one.iterdir()
        elif isinstance(one, Path) or (isinstance(one, str) and name in _NAMED):
            with suppress(WarehouseError):
                yield from files_behind(str(one))
