"""Pack a user's actions into the Simulator's array, with errors that name the robot."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from warehouse_env.errors import ActionError, shown
from warehouse_env.simulation.simulator import Simulator


class ActionPacker:
    """Gives the actions of one world's robots to its Simulator."""

    def __init__(self, names: Sequence[str], space: spaces.Space[Any]) -> None:
        """names: of the robots; space: of each action."""
        self._names, self._space = names, space
        self._whole: Any = np.zeros((1, len(names)), np.int64) if isinstance(space, spaces.Discrete) else None
        self._form = f"{len(names)}q"

    def step(self, simulator: Simulator, given: Sequence[Any]) -> None:
        """Step the world; ActionError names the first robot whose action the space does not hold."""
        packed = self._pack(given)
        try:
            simulator.step(packed)
        except ActionError:
            raise self._bad_action(given) from None

    def _pack(self, given: Sequence[Any]) -> NDArray[Any]:
        """Return int64[1, N], overwritten by the next call, or numbers [1, N, 2], whose values are not checked."""
        try:
            if self._whole is not None:  # struct takes whole numbers of any make, and takes half of numpy's time
                struct.pack_into(self._form, self._whole, 0, *given)
                return self._whole  # type: ignore[no-any-return]
            values = np.array([given])
        except (struct.error, TypeError, ValueError):  # ValueError: ragged
            raise self._bad_action(given) from None
        if values.ndim != 3 or values.dtype.kind not in "fiu":
            raise self._bad_action(given)
        return values

    def _bad_action(self, given: Sequence[Any]) -> ActionError:
        """Return (not raise) the error for the first action that the space does not hold."""
        names = self._names
        for name, action in zip(names, given, strict=True):
            problem = _problem(action, self._space)
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
