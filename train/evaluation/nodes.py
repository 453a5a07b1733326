"""The code and the library versions of a machine, which must be equal for equal rows."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import platform
from functools import cache
from pathlib import Path
from typing import NamedTuple

from warehouse_env import __version__
from warehouse_env.errors import WarehouseError

_PACKAGES = ("warehouse_env", "agents", "train")
_LIBRARIES = ("numpy", "numba", "llvmlite", "torch")


class Node(NamedTuple):
    """What a machine runs."""

    source: str  # digest of our own code
    versions: tuple[tuple[str, str], ...]  # of Python, of this project and of what it computes with
    processor: str  # kind, as compilers call it


@cache
def about_this_node() -> Node:
    """Return what this process runs."""
    from llvmlite import binding

    found = [("python", platform.python_version())]
    found += [("warehouse_env", __version__), *((name, importlib.metadata.version(name)) for name in _LIBRARIES)]
    homes = [Path(spec.origin).parent for name in _PACKAGES if (spec := importlib.util.find_spec(name)) and spec.origin]
    source = hashlib.sha256("".join(map(_source_digest, homes)).encode()).hexdigest()
    return Node(source[:16], tuple(found), binding.get_host_cpu_name())


def check_node(here: Node, there: Node) -> None:
    """Raise WarehouseError unless a node has the code and the library versions of this machine."""
    if there.versions != here.versions:
        pairs = [(a, b) for a, b in zip(there.versions, here.versions, strict=True) if a != b]
        theirs, ours = (", ".join(" ".join(pair[side]) for pair in pairs) for side in (0, 1))
    elif there.source != here.source:
        theirs, ours = f"sources {there.source}", here.source
    else:
        return
    raise WarehouseError(f"it has {theirs}, here it is {ours}")


def _source_digest(package: Path) -> str:
    """Return a digest of the content of a package's modules."""
    whole = hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        whole.update(f"{file.relative_to(package).as_posix()}\n".encode() + file.read_bytes())
    return whole.hexdigest()
