"""Test the kernel cache: one entry per version of a kernel's sources, also in read-only folders."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import warehouse_env
from warehouse_env.compiled import digest

SOURCE = """
import numpy as np
from warehouse_env.kernel import kernel, part

LIMIT = np.float32(2.0)
TABLE = np.arange(3)

@part
def inner(x):
    return x + 1

@kernel
def outer(x):
    '''Say it.'''
    return inner(x) * LIMIT + TABLE[1]

@kernel
def other(x):
    return x

def plain(x):
    return inner(x)

def driver(x):
    return plain(x)
"""


def digest_of(source: str, name: str = "outer") -> str:
    module: dict[str, Any] = {"__name__": "mine"}
    exec(compile(source, "mine.py", "exec"), module)
    return digest(module[name])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("inner(x) * LIMIT", "inner(x) + LIMIT"),
        ("x + 1", "x + 2"),
        ("LIMIT = np.float32(2.0)", "LIMIT = 2.0"),
        ("np.arange(3)", "np.arange(3) + 1"),
        ("@part", "@kernel"),
    ],
)
def test_digest_covers_all_sources_of_a_kernel(old: str, new: str) -> None:
    assert digest_of(SOURCE) != digest_of(SOURCE.replace(old, new))


@pytest.mark.parametrize(("old", "new"), [("x + 1", "x + 2"), ("return inner(x)\n", "return 0\n")])
def test_digest_covers_plain_functions_between_kernels(old: str, new: str) -> None:
    assert digest_of(SOURCE, "driver") != digest_of(SOURCE.replace(old, new), "driver")


def test_digest_covers_kernels_called_through_a_module(monkeypatch: pytest.MonkeyPatch) -> None:
    """Like a user's planner, call `module.function` instead of importing the function."""
    source = """
import warehouse_env.heap as heap
from warehouse_env.kernel import kernel

@kernel
def outer(keys, items):
    return heap.pop(keys, items, 1)
"""
    before = digest_of(source)
    monkeypatch.setattr(warehouse_env.heap, "pop", warehouse_env.heap.push)
    assert digest_of(source) != before


@pytest.mark.parametrize(
    ("old", "new"), [("Say it.", "Say more."), ("\n@kernel", "\n# why\n@kernel"), ("return x\n", "return 0\n")]
)
def test_digest_ignores_comments_and_unrelated_code(old: str, new: str) -> None:
    assert digest_of(SOURCE) == digest_of(SOURCE.replace(old, new))


def run(folder: Path, body: str, **environment: str) -> str:
    """Run Python in a folder, with `kept` as its kernel cache; return the output."""
    given = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "kept"), "PYTHONSAFEPATH": "", **environment}
    done = subprocess.run(
        [sys.executable, "-W", "always", "-c", body], cwd=folder, env=given, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_changed_callee_recompiles_and_old_version_stays_cached(tmp_path: Path) -> None:
    body = "import mine; print(mine.outer(1.0), sum(mine.outer.stats.cache_hits.values()))"
    (tmp_path / "mine.py").write_text(SOURCE, encoding="utf-8")
    assert run(tmp_path, body) == "5.0 0\n"
    assert run(tmp_path, body) == "5.0 1\n"
    (tmp_path / "mine.py").write_text(SOURCE.replace("x + 1", "x + 10"), encoding="utf-8")
    assert run(tmp_path, body) == "23.0 0\n"
    (tmp_path / "mine.py").write_text(SOURCE, encoding="utf-8")
    assert run(tmp_path, body) == "5.0 1\n"


def test_linked_kernel_is_reused_by_the_next_kernel(tmp_path: Path) -> None:
    body = "import mine; print(mine.outer(1.0), sum(mine.inner.stats.cache_hits.values()))"
    (tmp_path / "mine.py").write_text(SOURCE, encoding="utf-8")
    assert run(tmp_path, body) == "5.0 0\n"
    (tmp_path / "mine.py").write_text(SOURCE.replace("* LIMIT", "- LIMIT"), encoding="utf-8")
    assert run(tmp_path, body) == "1.0 1\n"


TUPLES = """
from typing import NamedTuple
from warehouse_env.kernel import kernel

class Pair(NamedTuple):
    one: float
    two: float

@kernel
def total(pair):
    return pair.one + pair.two
"""


def test_cached_code_for_a_removed_tuple_recompiles(tmp_path: Path) -> None:
    body = "import mine; print(mine.total(mine.{}(1.0, 2.0)), sum(mine.total.stats.cache_hits.values()))"
    (tmp_path / "mine.py").write_text(TUPLES, encoding="utf-8")
    assert run(tmp_path, body.format("Pair")) == "3.0 0\n"
    (tmp_path / "mine.py").write_text(TUPLES.replace("Pair", "Couple"), encoding="utf-8")
    assert run(tmp_path, body.format("Couple")) == "3.0 0\n"
    assert run(tmp_path, body.format("Couple")) == "3.0 1\n"


READ_ONLY = """
from numba.core import caching

def refuse(*arguments):
    raise PermissionError(13, "Permission denied")

caching.IndexDataCacheFile.save = refuse  # root may write anywhere
import mine
print(mine.outer(1.0), sum(mine.outer.stats.cache_hits.values()))
mine.outer(1), mine.other(1)
"""


def test_read_only_cache_is_used_and_warned_about_once(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(SOURCE, encoding="utf-8")
    run(tmp_path, "import mine; mine.outer(1.0)")
    printed = run(tmp_path, READ_ONLY)
    assert printed.startswith("5.0 1\n")
    assert printed.count("compiled kernels cannot be kept in") == 1
    assert "NUMBA_CACHE_DIR" in printed


def test_digests_agree_between_processes(tmp_path: Path) -> None:
    """Digests do not depend on set order and object addresses."""
    body = """
import gc
from numba.core.dispatcher import Dispatcher
from warehouse_env.compiled import digest
import warehouse_env.simulation.simulator
print(sorted(digest(one) for one in gc.get_objects() if isinstance(one, Dispatcher)))
"""
    first, second = (run(Path.cwd(), body, PYTHONHASHSEED=seed) for seed in ("1", "2"))
    assert first.count(",") > 100
    assert first == second


def test_no_cache_files_lie_beside_the_source() -> None:
    assert not list(Path(warehouse_env.__file__).parent.rglob("*.nb[ic]"))
