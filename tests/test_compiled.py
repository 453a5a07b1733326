"""Kept kernels are forgotten when any source file changes, and only then."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from warehouse_env.compiled import drop_stale_kernels


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Two modules, of which one has a kept kernel, and the package's stamp."""
    (tmp_path / "inner" / "__pycache__").mkdir(parents=True)
    for module in ("outer.py", "inner/helper.py"):
        (tmp_path / module).write_text("x = 1\n", encoding="utf-8")
    drop_stale_kernels(tmp_path)
    (tmp_path / "inner/__pycache__/step-1.py311.nbi").write_bytes(b"index")
    return tmp_path


def kept(package: Path) -> bool:
    drop_stale_kernels(package)
    return (package / "inner/__pycache__/step-1.py311.nbi").exists()


def test_an_unchanged_package_keeps_its_kernels(package: Path) -> None:
    assert kept(package)


@pytest.mark.parametrize("module", ["outer.py", "inner/helper.py"])
def test_one_changed_file_makes_all_kernels_stale(package: Path, module: str) -> None:
    (package / module).write_text("x = 2\n", encoding="utf-8")
    assert not kept(package)


def test_a_touched_file_is_the_same_source(package: Path) -> None:
    """Machines that share a disk may see other times, and must not drop each other's kernels."""
    os.utime(package / "outer.py", ns=(1, 1))
    assert kept(package)
    assert kept(package)


def test_in_a_folder_of_the_users_each_version_has_a_folder_of_its_own(tmp_path: Path) -> None:
    body = """
import numba
from warehouse_env.kernel import kernel
from warehouse_env.maps import clearance
print(numba.config.CACHE_DIR)
print(clearance.segment_gap._cache.cache_path)
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", body], env=environment, capture_output=True, text=True, check=True)
    chosen, ours = done.stdout.split()
    assert chosen == str(tmp_path)  # others' kernels stay where they were
    assert Path(ours).is_relative_to(tmp_path)
    assert Path(ours).relative_to(tmp_path).parts[0].startswith("warehouse-")


def test_a_new_and_a_lost_file_do_as_well(package: Path) -> None:
    (package / "new.py").write_text("", encoding="utf-8")
    assert not kept(package)
    (package / "inner/__pycache__/step-1.py311.nbi").write_bytes(b"index")
    (package / "outer.py").unlink()
    assert not kept(package)


def test_importing_the_package_looks() -> None:
    import warehouse_env

    assert (Path(warehouse_env.__file__).parent / "__pycache__" / "kernels.stamp").is_file()


def test_where_no_folder_can_be_written_kernels_are_compiled_and_not_kept(tmp_path: Path) -> None:
    """Root may write anywhere, so a file stands where each of Numba's folders would be."""
    import warehouse_env

    package = tmp_path / "warehouse_env"
    shutil.copytree(Path(warehouse_env.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [package, *(path for path in package.rglob("*") if path.is_dir())]:
        (folder / "__pycache__").touch()
    homes = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "IPYTHONDIR"), "/dev/null")
    body = "import warehouse_env.simulation.simulator"
    environment = {**os.environ, **homes, "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", body], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("compiled kernels cannot be kept") == 1
    assert "NUMBA_CACHE_DIR" in done.stderr
