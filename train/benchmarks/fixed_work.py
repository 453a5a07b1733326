"""Fixed work in C (engine_step.c) like that of the step, with which the step is compared on any machine.

It is the same in every version of this package: it calls nothing of it, and its floor, starts and commands are made
here.
"""

import ctypes
import math
import os
import shutil
import subprocess
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import WarehouseError

# Kernels do not fuse a product and a sum into one rounding, so C must not either.
FLAGS = ("-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC")
SOURCE = Path(__file__).parent / "engine_step.c"
SIDE, RAYS, POINTS = 46, 32, 64  # as in engine_step.c: cells of the floor's side, rays, way-points of a route
SEEN = RAYS + 6 * 6 + 2 * 5 + 2
POOL = 16  # random commands, cycled
_REAL = ("x", "y", "heading", "speed", "steer", "cosine", "sine", "middle_x", "middle_y", "reward")
ROBOT = np.dtype([*((name, np.float32) for name in _REAL), ("hit", np.int32), ("passed", np.int32)])


class Start(NamedTuple):
    """Poses of N robots in B worlds, their routes, and their commands."""

    pose: NDArray[np.float32]  # [B, N, 3], x, y [m] of the front axle, heading [rad]
    way: NDArray[np.float32]  # [B, N, POINTS, 2] [m]
    commands: NDArray[np.float32]  # [POOL, B, N, 2], acceleration and steering rate, each in [-1, 1]


def floor() -> NDArray[np.uint8]:
    """Return uint8[SIDE, SIDE]: shelves of 2 x 4 m between aisles, and a rim around them."""
    cell = np.arange(SIDE)
    inside = (cell >= 4) & (cell < 42)
    shelf = np.outer(inside & (cell % 4 < 2), inside & (cell % 8 >= 4))
    rim = (cell == 0) | (cell == SIDE - 1)
    return np.asarray(shelf | rim[:, None] | rim, np.uint8)


def start(worlds: int, robots: int) -> Start:
    """Return robots on free cells along the aisles, each with a winding route whose points are 1 m apart."""
    rng = np.random.default_rng(0)
    free = np.argwhere(floor() == 0)
    row, column = np.stack([free[rng.permutation(len(free))[:robots]] for _ in range(worlds)]).transpose(2, 0, 1)
    heading = 0.5 * math.pi * np.floor(4 * rng.random((worlds, robots)))
    pose = np.stack([column + 0.5, row + 0.5, heading], axis=-1).astype(np.float32)
    turns = heading[..., None] + 0.4 * (rng.random((worlds, robots, POINTS)) - 0.5).cumsum(axis=-1)
    way = pose[..., None, :2] + np.stack([np.cos(turns), np.sin(turns)], axis=-1).cumsum(axis=-2)
    commands = 2.4 * rng.random((POOL, worlds, robots, 2)) - 1.2
    commands[..., 0] += 0.1  # mostly ahead
    return Start(pose, way.astype(np.float32), np.clip(commands, -1, 1).astype(np.float32))


def compiler() -> str | None:
    """Return the C compiler, $CC or cc, if there is one."""
    return shutil.which(os.environ.get("CC") or "cc")


def _load(folder: Path) -> ctypes.CDLL:
    """Compile SOURCE into the folder and load it."""
    command = compiler()
    if command is None:
        raise WarehouseError("no C compiler: install one, or name it in the environment variable CC")
    library = folder / f"{SOURCE.stem}.so"
    done = subprocess.run([command, *FLAGS, "-o", library, SOURCE, "-lm"], capture_output=True, text=True, check=False)
    if done.returncode:
        raise WarehouseError(f"{command} could not compile {SOURCE.name}: {done.stderr.strip().splitlines()[-1:]}")
    return ctypes.CDLL(str(library))


def _address(array: NDArray[np.generic]) -> ctypes.c_void_p:
    """Return the address of a contiguous array."""
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


class FixedWork:
    """The work of N robots in B worlds; `robots` and `seen` hold the state after the last step."""

    def __init__(self, worlds: int, robots: int, folder: Path) -> None:
        """Compile into the folder; WarehouseError without a compiler or if it fails."""
        begin = start(worlds, robots)
        self.robots = np.zeros((worlds, robots), ROBOT)
        for name, values in zip(("x", "y", "heading"), np.moveaxis(begin.pose, -1, 0), strict=True):
            self.robots[name] = values
        self.seen = np.zeros((worlds, robots, SEEN), np.float32)
        self.way, self.commands = begin.way, begin.commands
        angle = 2 * math.pi * np.arange(RAYS) / RAYS
        rays = np.stack([np.cos(angle), np.sin(angle)]).astype(np.float32)
        self._given = (floor(), rays, self.robots.copy())  # kept alive, since C holds only their addresses
        shelf, lidar, before = (_address(array) for array in self._given)
        native = _load(folder).step
        native.restype = None
        sizes = (ctypes.c_int64(worlds), ctypes.c_int64(robots))
        self._call = partial(native, *sizes, shelf, lidar, _address(self.robots), before, _address(self.way))

    def __call__(self, k: int) -> None:
        """Do step k."""
        self._call(_address(self.commands[k % POOL]), _address(self.seen))
