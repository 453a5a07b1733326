"""From the actions a user gives to the array that the Simulator takes, with errors that name the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from warehouse_env.errors import ActionError


def blank_actions(space: spaces.Space[Any], worlds: int, robots: int) -> NDArray[Any]:
    """Return zeros in the shape and type that `Simulator.step` takes: int64[B,N] or float32[B,N,2]."""
    shape = space.shape or ()
    return np.zeros((worlds, robots, *shape), dtype=space.dtype)


def write_actions(target: NDArray[Any], given: Sequence[Any], names: Sequence[str], space: spaces.Space[Any]) -> None:
    """Copy one action per name into `target` [K] or [K, 2]; raises ActionError naming the first bad one.

    Only the shape and kind are checked here; finiteness and range are the Simulator's to check.
    """
    try:
        values = np.array(given)
    except ValueError:  # ragged
        values = np.empty(0)
    whole = isinstance(space, spaces.Discrete)
    if values.shape != target.shape or values.dtype.kind not in ("iu" if whole else "fiu"):
        raise bad_action(given, names, space)
    target[:] = values


def bad_action(given: Sequence[Any], names: Sequence[str], space: spaces.Space[Any]) -> ActionError:
    """Return (not raise) the error for the first action that the space does not hold."""
    for name, action in zip(names, given, strict=True):
        problem = _problem(action, space)
        if problem:
            return ActionError(f"action of {name}: {problem}")
    return ActionError(f"the actions of {names[0]} to {names[-1]} do not fit together in one array")


def _problem(action: Any, space: spaces.Space[Any]) -> str:
    """Return what is wrong with one action, or an empty string."""
    try:
        value = np.asarray(action)
    except ValueError:
        return f"{action!r} is not an array of numbers"
    if isinstance(space, spaces.Discrete):
        if value.shape != () or value.dtype.kind not in "iu":
            return f"{action!r} is not one whole number"
        if not 0 <= int(value) < space.n:
            return f"{action!r} is outside 0..{space.n - 1}"
        return ""
    if value.dtype.kind not in "fiu":
        return f"{action!r} is not an array of numbers"
    if value.shape != space.shape:
        return f"shape {value.shape} given, {space.shape} needed"
    if not np.isfinite(value).all():
        return f"{value.tolist()} has a value that is not finite"
    return ""
