"""Parts of one's own, named as people type them: "my_policy.py:Mine" or "package.module:Mine".

Such a name is code that runs when it is looked up, so only who asks for it by `load` has it run: the command line does
with what was typed. What is loaded goes into a registry under the name as it was typed, and is found there by name like
any other. Names that stand in files, of rows, episodes or weights, are only looked up.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any, NamedTuple

from warehouse_env.checked import parse_named
from warehouse_env.errors import ConfigError, WarehouseError, shown, unknown_name
from warehouse_env.files import STAGED, file_digest, whereabouts

_NAME = re.compile(r"(?P<home>[^:]+\.py|(?:[^\W\d]\w*)(?:\.[^\W\d]\w*)*):(?P<name>[^\W\d]\w*)(?::(?P<rest>.*))?", re.S)

_OURS = ("warehouse_env", "agents", "train")


class OwnPart(NamedTuple):
    """What was loaded."""

    kind: str  # "policy", "planner" or "layout"
    made: Any  # the class or function
    digest: str  # of the file it is in, as it was loaded


LOADED: dict[str, OwnPart] = {}
"""Name as it was typed, without parameters -> the part."""


def split(text: str) -> tuple[str, str] | None:
    """Return the name of a part of one's own and the parameters behind it; None for any other text."""
    found = _NAME.fullmatch(text)
    return (f"{found['home']}:{found['name']}", found["rest"] or "") if found else None


def parse(text: Any, kind: str, example: str, known: Container[str]) -> tuple[Any, dict[str, Any]]:
    """Read "NAME:KEY=VALUE,KEY=VALUE" as `parse_named` does, where NAME may be a part of one's own.

    known: the registry, whose names come first.
    """
    part = split(text) if isinstance(text, str) and text.partition(":")[0] not in known else None
    if part is None:
        return parse_named(text, kind, example)
    return part[0], parse_named(f"{kind}:{part[1]}", kind, example)[1]


def load(name: str, kind: str) -> Any:
    """Run the file or import the module of a part and return what it names there; ConfigError in one sentence.

    name: without parameters. What the code imports is looked for in the file's folder, too, or for a module in the
    working folder, but only where nothing installed has that name. No other file there is run.
    """
    if name not in LOADED:
        home, _, inner = name.rpartition(":")
        module = _run_file(home, kind, name) if home.endswith(".py") else _import(home, kind, name)
        if not hasattr(module, inner):
            known = [one for one, value in vars(module).items() if callable(value) and not one.startswith("_")]
            raise unknown_name(f"{kind} {shown(name)}: {home} has no", inner, known or ["nothing to call"])
        LOADED[name] = OwnPart(kind, getattr(module, inner), _digest(module))
    return LOADED[name].made


def digests(*names: str) -> dict[str, str]:
    """Return name -> digest of the code for those of the names, parameters allowed, that are parts of one's own."""
    parts = [part[0] for part in map(split, names) if part]
    return {name: LOADED[name].digest for name in parts if name in LOADED}


def unknown(kind: str, name: Any, known: Iterable[str]) -> ConfigError:
    """Return (not raise) the error for a name that a registry does not hold; of code that nobody asked to run, too."""
    if isinstance(name, str) and split(name):
        return ConfigError(
            f"{kind} {shown(name)} is code, and runs only where the command itself names it, by --{kind} {shown(name)}"
        )
    if isinstance(name, str) and name.endswith(".py"):
        return ConfigError(f"{kind} {shown(name)} must name what is meant in that file, too, as in {name}:Mine")
    return unknown_name(kind, name, known)


def check_has(name: str, kind: str, made: object, members: Iterable[str]) -> None:
    """Raise ConfigError for the first member that a part lacks."""
    for member in members:
        if not hasattr(made, member.partition("(")[0]):
            raise ConfigError(f"{name} is no {kind}: it has no {member}")


@contextmanager
def running(name: str) -> Iterator[None]:
    """Say in one sentence which line of a part's own code failed: ConfigError."""
    try:
        yield
    except WarehouseError:
        raise
    except Exception as error:
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename != __file__]
        where = f"{frames[-1].filename}, line {frames[-1].lineno}" if frames else name
        if isinstance(error, SyntaxError):
            where = f"{error.filename}, line {error.lineno}"
        raise ConfigError(f"{name} fails at {where}: {type(error).__name__}: {shown(str(error))[1:-1]}") from error


def _run_file(home: str, kind: str, name: str) -> ModuleType:
    path = Path(os.path.abspath(whereabouts(home)))
    if not path.is_file():
        raise ConfigError(f"{kind} {shown(name)}: there is no file {home}")
    own = _own_name(home)
    if own in sys.modules:
        return sys.modules[own]
    spec = importlib.util.spec_from_file_location(own, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[own] = module  # where dataclasses and pickles look it up
    _BESIDE.serve(own, path.parent)
    try:
        with running(name):
            spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[own]
        raise
    return module


def _own_name(home: str) -> str:
    """Return the module that a file becomes, beside any other of its name."""
    path = os.path.abspath(whereabouts(home))
    return f"own_{Path(path).stem}_{hashlib.blake2b(path.encode(), digest_size=4).hexdigest()}"


def _import(home: str, kind: str, name: str) -> ModuleType:
    folder = STAGED[home].parent if home in STAGED else Path.cwd()
    _BESIDE.serve(__name__, folder)
    try:
        with running(name):
            module = importlib.import_module(home)
    except ConfigError as error:
        missing = error.__cause__
        if isinstance(missing, ModuleNotFoundError) and f"{home}.".startswith(f"{missing.name}."):
            raise ConfigError(f"{kind} {shown(name)}: there is no module {missing.name} here or installed") from None
        raise
    if _home_of(home) == str(folder):
        _BESIDE.serve(home.partition(".")[0], folder)
    return module


def loaded_files(home: str) -> dict[str, Path]:
    """Return the files of a part that is loaded, by their names in its folder: its own, then what it imported there."""
    own = next((name for name in (_own_name(home), home) if name in sys.modules), "")
    folder = _BESIDE.folder_of(own)
    if folder is None:
        return {}
    loaded = [name for name in list(sys.modules) if name.partition(".")[0] not in _OURS and _home_of(name) == folder]
    files = [Path(file) for name in (own, *loaded) if (file := getattr(sys.modules[name], "__file__", None))]
    return {file.relative_to(folder).as_posix(): file for file in files if file.is_relative_to(folder)}


def _home_of(name: str) -> str | None:
    """Return the folder that holds a module that is loaded, or the package that it is in."""
    top = sys.modules.get(name.partition(".")[0])
    places = [*getattr(top, "__path__", ()), getattr(top, "__file__", None)]
    return os.path.dirname(places[0]) if isinstance(places[0], str) else None


class _Beside(MetaPathFinder):
    """Finds modules for code of one's own, beside it: the last finder, so nothing there stands in for another module.

    A folder on sys.path would serve all modules of this process, and of those that it starts: these would take a file
    there that is called as one of our packages, or as one that may be missing, for it.
    """

    def __init__(self) -> None:
        self._folders: dict[str, str] = {}  # module, a package for all that is in it -> the folder for its imports

    def serve(self, module: str, folder: Path) -> None:
        """Look in a folder for what a module imports, and for what that imports."""
        self._folders[module] = str(folder)
        if self not in sys.meta_path:
            sys.meta_path.append(self)

    def folder_of(self, module: str) -> str | None:
        """Return the folder in which a module looks for its imports, if it is code of one's own."""
        return self._folders.get(module, self._folders.get(module.partition(".")[0]))

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return what lies beside the code that imports a module; None if there is none, or the code is another's."""
        frame: FrameType | None = sys._getframe(1)
        while frame and frame.f_globals.get("__name__", "").partition(".")[0] == "importlib":
            frame = frame.f_back
        folder = self.folder_of(frame.f_globals.get("__name__", "")) if frame and path is None else None
        spec = None if folder is None else PathFinder.find_spec(fullname, [folder])
        if spec is not None and folder is not None:
            self.serve(fullname, Path(folder))
        return spec


_BESIDE = _Beside()


def _digest(module: ModuleType) -> str:
    try:
        return file_digest(Path(inspect.getfile(module)))
    except (ValueError, TypeError):  # a module without a file
        return ""
