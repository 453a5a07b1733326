"""Check poses and speeds from users, and reduce headings to one turn.

Kernels rely on the result: finite numbers, points on the floor, headings in [-pi, pi], speeds within the limits. No
other code checks them.
"""

import contextlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.errors import ConfigError, shown
from warehouse_env.maps.grid_map import GridMap

_HALF_TURN = float(np.float32(math.pi))  # [rad]: headings in single precision stay what they are


def within_a_turn(heading: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return headings [rad] in [-pi, pi]; nan stays."""
    rest = np.fmod(heading.astype(np.float64), math.tau)  # exact
    rest -= math.tau * np.sign(rest) * (abs(rest) > math.pi)
    return np.where(abs(heading) <= _HALF_TURN, heading, rest)


def numbers(what: str, given: object, *shapes: tuple[int, ...], rule: str = "", nan: bool = False) -> NDArray[Any]:
    """Return finite numbers of one of the shapes, in which -1 is any length; ConfigError for others.

    rule: what they must be, if not said by the shapes; nan: those from the third on may be nan.
    """
    array, found = np.empty(0), np.empty(0)
    with contextlib.suppress(TypeError, ValueError, OverflowError, RecursionError), np.errstate(all="ignore"):
        array = np.asarray(given)  # fails unless it is a table
        found = array.astype(np.float64) if array.dtype.kind in "iuf" else found
    fits = any(
        len(shape) == found.ndim and all(wanted in (-1, have) for wanted, have in zip(shape, found.shape, strict=True))
        for shape in shapes
    )
    if not (fits and np.isfinite(found if not nan else found[..., :2]).all() and not np.isinf(found).any()):
        raise ConfigError(f"{what}={shown(given)} must be {rule or f'finite numbers of shape {shapes[-1]}'}")
    return found


def poses(what: str, given: object, shape: tuple[int, ...], grid: GridMap) -> NDArray[np.float64]:
    """Return poses [..., 3] (x [m], y [m], heading [rad]) or points [..., 2] on the floor; ConfigError for others."""
    found = numbers(what, given, shape)
    points, side = found[..., :2].astype(np.float32), (grid.cell_size * np.array(grid.shape[::-1])).astype(np.float32)
    off = ((points < 0) | (points > side)).any(axis=-1)
    if off.any():
        (x, y), (wide, deep) = found[off][0, :2].tolist(), side.tolist()
        raise ConfigError(f"{what}: ({x:g}, {y:g}) is not on the floor of {wide:g} x {deep:g} m")
    found[..., 2:] = within_a_turn(found[..., 2:])
    return found


def speeds(given: object, worlds: int, robots: Sequence[RobotSpec]) -> NDArray[np.float64]:
    """Return speeds float64[B, N] [m/s] within the robots' limits, from as many or one for all; else ConfigError."""
    shape = worlds, len(robots)
    found = np.broadcast_to(numbers("speed", given, (), shape), shape)
    low, high = np.array([(robot.min_speed, robot.max_speed) for robot in robots], np.float32).T
    for world, robot in np.argwhere((found.astype(np.float32) < low) | (found.astype(np.float32) > high)).tolist():
        raise ConfigError(
            f"speed: {found[world, robot]:g} m/s of robot {robot} must lie between {low[robot]:g} and {high[robot]:g}, "
            "the limits of its kind"
        )
    return found
