"""Which code made a row: a digest that changes when a planner's own code does, not with its words or its neighbours."""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

_PROJECT = ("warehouse_env.", "agents.", "train.")
# What plans and their figures depend on, and what drives, too.
PLANNING = ("warehouse_env.planning.", "warehouse_env.routes.", "warehouse_env.traffic.", "train.tables.")
DRIVING = ("train.tables.", "train.evaluation.", "train.books", "warehouse_env.", "agents.")


@cache
def code_key(planner: type) -> str:
    """Return 16 hex digits for the code of a planner's class and of all that it is built on."""
    return code_of(*(cls.__module__ for cls in planner.__mro__ if cls.__module__.startswith(PLANNING)))


@cache
def code_of(*modules: str, within: tuple[str, ...] = PLANNING) -> str:
    """Return 16 hex digits for the code of modules and of all that they import, directly or not, `within` packages.

    Comments and docstrings do not count.
    """
    content = hashlib.blake2b(digest_size=8)
    for module in _closure(modules, within):
        content.update(ast.dump(_without_docstrings(_tree(module))).encode())
    return content.hexdigest()


def _closure(modules: Iterable[str], within: tuple[str, ...] = PLANNING) -> list[str]:
    """Return the modules and all that they import `within` packages, directly or not, in order of their names."""
    todo, known = list(modules), set()
    while todo:
        module = todo.pop()
        if module not in known:
            known.add(module)
            todo += [name for name in _imported(_tree(module)) if name.startswith(within)]
    return sorted(known)


def _imported(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for name in (node.module, *(f"{node.module}.{alias.name}" for alias in node.names)):
                if name.startswith(_PROJECT) and _file(name) is not None:
                    yield name


@cache
def _file(module: str) -> Path | None:
    """Return the file of a module's code, None if there is no such module."""
    try:
        found = importlib.util.find_spec(module)
    except ModuleNotFoundError:  # its parent is a module, no package
        return None
    return Path(found.origin) if found is not None and found.origin else None


@cache
def _tree(module: str) -> ast.Module:
    path = _file(module)
    assert path is not None, module
    return ast.parse(path.read_bytes())


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return tree
