"""Actions as tensors -> commands on the device, as the Simulator decodes them (simulation/actions.py)."""

from typing import Any

import numpy as np
import torch

from warehouse_env.config import EnvConfig
from warehouse_env.errors import ActionError
from warehouse_env.simulation.actions import ActionDecoder
from warehouse_env.simulation.device import drivers
from warehouse_env.simulation.device.memory import Memory, mapped, tensor_of
from warehouse_env.simulation.senses import preferences
from warehouse_env.simulation.worlds import Worlds


def _where(chosen: torch.Tensor, one: Any, other: Any) -> torch.Tensor:
    how: dict[str, Any] = {"dtype": torch.float64, "device": chosen.device}
    return torch.where(chosen, torch.as_tensor(one, **how), torch.as_tensor(other, **how))


class TensorDecoder:
    """Write what actions mean into the tensors `commands` and `choices` of the worlds."""

    def __init__(self, config: EnvConfig, decoder: ActionDecoder, memory: Memory) -> None:
        """Copy the tables of a decoder to the device."""
        self._kind, self._decoder, self._memory = config.action_type, decoder, memory
        self._table, self._sides = (tensor_of(array).to(memory.device) for array in (decoder.table, decoder.sides))
        self._limits = mapped(decoder.limits, lambda array: tensor_of(array).to(memory.device))
        self._likes: tuple[torch.Tensor, drivers.Likes] | None = None  # made for the first preferences

    def decode(self, actions: torch.Tensor, tensors: dict[str, torch.Tensor], worlds: Worlds) -> torch.Tensor:
        """Write commands and choices; return whether all actions are valid, as a tensor.

        worlds: the same memory as the tensors, as kernels see it. ActionError for another shape or type.
        """
        past, choices = tensors["commands"], tensors["choices"]
        if len(past) > 1:
            past[1:] = past[:-1].clone()
        if self._kind == "discrete" and actions.ndim == 3:
            valid = self._rank(actions, past[0], worlds)
        else:
            valid = self._look_up(actions, past[0]) if self._kind == "discrete" else self._scale(actions, past[0])
            if choices.numel():
                preferences.obey(past[0], self._sides, choices)
        self._decoder.cap(past[0], choices, self._limits)
        return valid

    def _rank(self, actions: torch.Tensor, commands: torch.Tensor, worlds: Worlds) -> torch.Tensor:
        """Decode preferences float[B, N, A]."""
        _check("preferences", actions, (*commands.shape[:2], len(self._table)), floating=True)
        if self._likes is None:
            memory, order = self._memory, np.empty(len(self._sides), np.int64)
            liked, view = memory.allocate(actions.shape, np.dtype(np.float32))
            table, sides = memory.constant(self._decoder.table), memory.constant(self._decoder.sides)
            threads = memory.threads(len(actions))
            likes = drivers.Likes(table, sides, view, worlds.commands, worlds.choices, memory.scratch(threads, order))
            self._likes = liked, likes
        liked, likes = self._likes
        liked.copy_(actions)
        self._memory.launch(drivers.rank, len(likes.order), likes)
        return ~actions.isnan().any()

    def _look_up(self, actions: torch.Tensor, commands: torch.Tensor) -> torch.Tensor:
        """Decode discrete actions int[B, N]."""
        _check("discrete actions", actions, commands.shape[:2], floating=False)
        count = len(self._table)
        commands.copy_(self._table[actions.clamp(0, count - 1).long()])
        return ((actions >= 0) & (actions < count)).all()

    def _scale(self, actions: torch.Tensor, commands: torch.Tensor) -> torch.Tensor:
        """Decode continuous or raw actions float[B, N, 2]."""
        _check(f"{self._kind} actions", actions, commands.shape, floating=True)
        self._decoder.write_scaled(actions.clip(-1, 1), commands, self._limits, _where)
        return actions.isfinite().all()


def _check(what: str, actions: torch.Tensor, shape: tuple[int, ...], floating: bool) -> None:
    if actions.shape != shape or actions.dtype.is_floating_point is not floating:
        kind = "numbers" if floating else "whole numbers"
        raise ActionError(f"{what} must be {kind} of shape {tuple(shape)}, not {actions.dtype} {tuple(actions.shape)}")
