"""What must be the same on two machines for the same rows, and what may differ."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import platform
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

from warehouse_env import __version__
from warehouse_env.errors import WarehouseError

_PACKAGES = ("warehouse_env", "agents", "train")
_LIBRARIES = ("numpy", "numba", "llvmlite", "torch")


class Node(NamedTuple):
    """A machine as a program sees it."""

    source: str  # digest of our own code
    versions: tuple[tuple[str, str], ...]  # of Python, of this project and of what it computes with
    processor: str  # kind, as compilers call it


@cache
def about_this_node() -> Node:
    """Return what this process runs on."""
    from llvmlite import binding

    found = [("python", platform.python_version())]
    found += [("warehouse_env", __version__), *((name, importlib.metadata.version(name)) for name in _LIBRARIES)]
    homes = [Path(spec.origin).parent for name in _PACKAGES if (spec := importlib.util.find_spec(name)) and spec.origin]
    source = hashlib.sha256("".join(map(_source_digest, homes)).encode()).hexdigest()
    return Node(source[:16], tuple(found), binding.get_host_cpu_name())


def check_nodes(here: Node, nodes: Mapping[str, Node]) -> Iterator[str]:
    """Yield a note for each node with another processor; WarehouseError for one whose rows would be other code's."""
    for address, node in nodes.items():
        if node.source != here.source or node.versions != here.versions:
            theirs, ours = _apart(node, here)
            raise WarehouseError(f"node {address} has {theirs}, here it is {ours}: install the same on both")
    for address, node in nodes.items():
        if node.processor != here.processor:
            yield (
                f"node {address} has another processor ({node.processor}, here {here.processor}): figures may differ "
                "in the last digits, and so, in the long run, may episodes"
            )


def _apart(node: Node, here: Node) -> tuple[str, str]:
    """Return what differs, there and here, in words."""
    pairs = [(a, b) for a, b in zip(node.versions, here.versions, strict=True) if a != b]
    if not pairs:
        return f"sources {node.source}", here.source
    return ", ".join(" ".join(a) for a, _ in pairs), ", ".join(" ".join(b) for _, b in pairs)


def _source_digest(package: Path) -> str:
    """Return a digest of the content of a package's modules."""
    whole = hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        whole.update(f"{file.relative_to(package).as_posix()}\n".encode() + file.read_bytes())
    return whole.hexdigest()
