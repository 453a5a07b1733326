"""From the actions a user gives to the array that the Simulator takes, with errors that name the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from warehouse_env.errors import ActionError, shown


def pack_actions(given: Sequence[Any], names: Sequence[str], space: spaces.Space[Any]) -> NDArray[Any]:
    """Return the actions of a world's robots as an array [1, N] or [1, N, 2] for `Simulator.step`.

    Raises ActionError naming the first of wrong shape or kind; values are the Simulator's to check.
    """
    try:
        values = np.array([given])
    except ValueError:  # ragged
        raise bad_action(given, names, space) from None
    whole = isinstance(space, spaces.Discrete)
    if values.ndim != (2 if whole else 3) or values.dtype.kind not in ("iu" if whole else "fiu"):
        raise bad_action(given, names, space)
    return values


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
        return f"{shown(action)} is not an array of numbers"
    if isinstance(space, spaces.Discrete):
        if value.shape != () or value.dtype.kind not in "iu":
            return f"{shown(action)} is not one whole number"
        if not 0 <= int(value) < space.n:
            return f"{shown(action)} is outside 0..{space.n - 1}"
        return ""
    if value.dtype.kind not in "fiu":
        return f"{shown(action)} is not an array of numbers"
    if value.shape != space.shape:
        return f"shape {value.shape} given, {space.shape} needed"
    if not np.isfinite(value).all():
        return f"{value.tolist()} has a value that is not finite"
    return ""
