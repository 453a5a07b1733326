"""Plugins: a user's policies, planners, layouts, sensors and tasks, as typed: "my_policy.py:Mine" or "module:Mine".

Looking such a name up runs code, so only `load` does it, which the command line calls with what was typed. A loaded
plugin goes into a registry under that name and is found there like any other. Names that stand in files (rows,
episodes, weights) never run code.
"""

import hashlib
import importlib
import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from warehouse_env.checked import parse_named
from warehouse_env.errors import ConfigError, WarehouseError, check_known, shown, unknown_name
from warehouse_env.files import STAGED, file_digest, whereabouts

_NAME = re.compile(r"(?P<home>[^:]+\.py|(?:[^\W\d]\w*)(?:\.[^\W\d]\w*)*):(?P<name>[^\W\d]\w*)(?::(?P<rest>.*))?", re.S)

_OURS = ("warehouse_env", "agents", "train")


class Plugin(NamedTuple):
    """A loaded plugin."""

    kind: str  # "policy", "planner", "layout", "sensor" or "tasks"
    made: Any  # the class or function
    digest: str  # of the file it is in, as it was loaded


LOADED: dict[str, Plugin] = {}
"""Name as it was typed, without parameters -> the plugin."""


def split(text: str) -> tuple[str, str] | None:
    """Return the name of a plugin and the parameters behind it; None for any other text."""
    found = _NAME.fullmatch(text)
    return (f"{found['home']}:{found['name']}", found["rest"] or "") if found else None


_EXAMPLES = {"planner": "pf_aco:ants=20,patience=null", "layout": "aisles:seed=7,rows=40"}


def parse(text: Any, kind: str, known: Container[str]) -> tuple[Any, dict[str, Any]]:
    """Read "NAME:KEY=VALUE,KEY=VALUE" as `parse_named` does, where NAME may be a plugin.

    known: the registry, whose names come first.
    """
    part = split(text) if isinstance(text, str) and text.partition(":")[0] not in known else None
    if part is None:
        return parse_named(text, kind, _EXAMPLES.get(kind, "my_file.py:Mine:reach=3"))
    return part[0], parse_named(f"{kind}:{part[1]}", kind, _EXAMPLES.get(kind, "my_file.py:Mine:reach=3"))[1]


def add(text: str, kind: str, registry: dict[str, Any], members: Iterable[str] = ()) -> Any:
    """Load a plugin into its registry and return it, or None if it is there already; ConfigError if it is none.

    members: of what a class makes. An attribute `version` becomes the digest of its file.
    """
    name, _ = parse(text, kind, registry)
    if name in registry or not split(name):
        return None
    made = load(name, kind)
    if not callable(made):
        raise ConfigError(f"{name} cannot be used as {kind}: it must be a class or a function")
    if isinstance(made, type):
        check_has(name, kind, made, members)
    if hasattr(made, "version"):
        made.version = LOADED[name].digest
    registry[name] = made
    return made


def make(text: Any, kind: str, registry: Mapping[str, Any], parameters: Mapping[str, Any], *given: object) -> Any:
    """Call what a registry holds under a name, with the arguments `given` and the name's parameters.

    parameters: override those of the name. ConfigError for an unknown name or parameter, and where a plugin fails.
    """
    name, named = parse(text, kind, registry)
    if not isinstance(name, str) or name not in registry:
        raise unknown(kind, name, registry)
    chosen, known = {**named, **parameters}, [*inspect.signature(registry[name]).parameters][len(given) :]
    if chosen and not known:
        raise ConfigError(f"{kind} {name} takes no parameters; leave out {', '.join(chosen)}")
    check_known(f"parameter of {kind} {name!r}:", chosen, known)
    with running(name) if name in LOADED else nullcontext():
        return registry[name](*given, **chosen)


def load(name: str, kind: str) -> Any:
    """Run the file or import the module of a plugin and return what it names there; ConfigError in one sentence.

    name: without parameters. While it loads, its imports are also looked for in the file's folder, or for a module in
    the working folder, after all installed packages.
    """
    if name not in LOADED:
        home, _, inner = name.rpartition(":")
        module = _run_file(home, kind, name) if home.endswith(".py") else _import(home, kind, name)
        if not hasattr(module, inner):
            known = [one for one, value in vars(module).items() if callable(value) and not one.startswith("_")]
            raise unknown_name(f"{kind} {shown(name)}: {home} has no", inner, known or ["nothing to call"])
        LOADED[name] = Plugin(kind, getattr(module, inner), _digest(module))
    return LOADED[name].made


def digests(*names: str) -> dict[str, str]:
    """Return name -> digest of the code for those of the names, parameters allowed, that are plugins."""
    parts = [part[0] for part in map(split, names) if part]
    return {name: LOADED[name].digest for name in parts if name in LOADED}


def unknown(kind: str, name: Any, known: Iterable[str]) -> ConfigError:
    """Return (not raise) the error for a name that is not in a registry, also for code that was not loaded."""
    if isinstance(name, str) and split(name):
        return ConfigError(
            f"{kind} {shown(name)} is code, and runs only where the command itself names it, by --{kind} {shown(name)}"
        )
    if isinstance(name, str) and name.endswith(".py"):
        return ConfigError(f"{kind} {shown(name)} must name what is meant in that file, too, as in {name}:Mine")
    return unknown_name(kind, name, known)


def check_has(name: str, kind: str, made: object, members: Iterable[str]) -> None:
    """Raise ConfigError for the first member that a plugin lacks."""
    for member in members:
        if not hasattr(made, member.partition("(")[0]):
            raise ConfigError(f"{name} cannot be used as {kind}: it has no {member}")


@contextmanager
def running(name: str) -> Iterator[None]:
    """Say in one sentence which line of a plugin failed: ConfigError."""
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


@contextmanager
def _loading(name: str, folder: Path) -> Iterator[None]:
    """Look for imports in a folder, too, but last; ConfigError if the code fails.

    Only while it loads: worker processes start with a copy of sys.path, and would take a file with the name of one of
    our packages for that package.
    """
    added = [str(folder)] if str(folder) not in sys.path else []
    sys.path.extend(added)
    try:
        with running(name):
            yield
    finally:
        for place in added:
            sys.path.remove(place)


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
    try:
        with _loading(name, _beside(home)):
            spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[own]
        raise
    return module


def _own_name(home: str) -> str:
    """Return the module that a file becomes, beside any other of its name."""
    path = os.path.abspath(whereabouts(home))
    return f"own_{Path(path).stem}_{hashlib.blake2b(path.encode(), digest_size=4).hexdigest()}"


def _beside(home: str) -> Path:
    """Return the folder in which a plugin's own imports are looked for."""
    if home.endswith(".py"):
        return Path(os.path.abspath(whereabouts(home))).parent
    return STAGED[home].parent if home in STAGED else Path.cwd()


def _import(home: str, kind: str, name: str) -> ModuleType:
    try:
        with _loading(name, _beside(home)):
            return importlib.import_module(home)
    except ConfigError as error:
        missing = error.__cause__
        if isinstance(missing, ModuleNotFoundError) and f"{home}.".startswith(f"{missing.name}."):
            raise ConfigError(f"{kind} {shown(name)}: there is no module {missing.name} here or installed") from None
        raise


def loaded_files(home: str) -> dict[str, Path]:
    """Return the files of a loaded plugin by their names in its folder: its own, then what it imported from there."""
    own, folder = _own_name(home) if home.endswith(".py") else home, str(_beside(home))
    if home not in {name.rpartition(":")[0] for name in LOADED} or _folder_of(own) != folder:
        return {}
    beside = [name for name in list(sys.modules) if name.partition(".")[0] not in _OURS and _folder_of(name) == folder]
    files = [Path(file) for name in (own, *beside) if (file := getattr(sys.modules[name], "__file__", None))]
    return {file.relative_to(folder).as_posix(): file for file in files if file.is_relative_to(folder)}


def _folder_of(name: str) -> str | None:
    """Return the folder that holds a loaded module, or the package that it is in."""
    top = sys.modules.get(name.partition(".")[0])
    places = [*getattr(top, "__path__", ()), getattr(top, "__file__", None)]
    return os.path.dirname(places[0]) if isinstance(places[0], str) else None


def _digest(module: ModuleType) -> str:
    try:
        return file_digest(Path(inspect.getfile(module)))
    except (ValueError, TypeError):  # a module without a file
        return ""
