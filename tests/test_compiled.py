"""Kept kernels are forgotten when any source file changes, and only then."""

from __future__ import annotations

import os
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
def test_one_touched_file_makes_all_kernels_stale(package: Path, module: str) -> None:
    os.utime(package / module, ns=(1, 1))
    assert not kept(package)


def test_a_new_and_a_lost_file_do_as_well(package: Path) -> None:
    (package / "new.py").write_text("", encoding="utf-8")
    assert not kept(package)
    (package / "inner/__pycache__/step-1.py311.nbi").write_bytes(b"index")
    (package / "outer.py").unlink()
    assert not kept(package)


def test_importing_the_package_looks() -> None:
    import warehouse_env

    assert (Path(warehouse_env.__file__).parent / "__pycache__" / "kernels.stamp").is_file()
