"""Our C files, compiled where there is a compiler."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import WarehouseError

# No contraction of a product and a sum into one rounding: kernels have none either, and it would change results.
FLAGS = ("-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC")


def compiler() -> str | None:
    """Return the C compiler: $CC, or cc, if there is one."""
    return shutil.which(os.environ.get("CC") or "cc")


def load(source: Path, folder: Path) -> ctypes.CDLL:
    """Compile a C file into the folder and load it; WarehouseError without a compiler or where it fails."""
    command = compiler()
    if command is None:
        raise WarehouseError("no C compiler: install one, or name it in the environment variable CC")
    library = folder / f"{source.stem}.so"
    done = subprocess.run([command, *FLAGS, "-o", library, source, "-lm"], capture_output=True, text=True, check=False)
    if done.returncode:
        raise WarehouseError(f"{command} could not compile {source.name}: {done.stderr.strip().splitlines()[-1:]}")
    return ctypes.CDLL(str(library))


def address(array: NDArray[np.generic]) -> ctypes.c_void_p:
    """Return the address of an array without gaps."""
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)
