"""Goals and live routes of a device's robots, which the host gives them on a copy of the robots.

A search for a route is long and branches, which a GPU does slowly, while the cores of the host would only wait.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.simulation import state
from warehouse_env.simulation.device.memory import Memory
from warehouse_env.simulation.draws import Draws
from warehouse_env.simulation.physics.deviation import planned_config
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.tasks.dispatch import Dispatcher
from warehouse_env.simulation.traffic.live import SMALL


class LiveOnHost:
    """Gives a device's robots goals and live routes, by a Dispatcher of all worlds."""

    def __init__(self, host: Simulator, draws: Draws, memory: Memory) -> None:
        """Make a dispatcher of as many worlds as there are draws; ConfigError where the floor is too large."""
        if not host.dispatcher.by_live:
            raise ConfigError(
                f"a device has live routes only on floors of up to {SMALL} x {SMALL} cells, and map "
                f"{host.grid.name!r} is larger: leave live routes out (in commands, --traffic rules:routes=false), or "
                "use the CPU"
            )
        worlds, robots = len(draws.keys), host.num_agents
        on_gpu = memory.device.type == "cuda"
        self._held = torch.zeros((worlds, robots, state.ROBOT.itemsize), dtype=torch.uint8, pin_memory=on_gpu)
        self._robots = self._held.numpy().view(state.ROBOT)[..., 0]
        self._floor, nobody = host.setup.floor, np.repeat(host.people.persons[:1], worlds, axis=0)
        vehicles = host.setup.planned
        parts = nobody, (vehicles.shared, vehicles.kinds), draws
        self.dispatcher = Dispatcher(planned_config(host.config), host.route_book, self._robots, *parts)
        assert self.dispatcher.live is not None
        self._live = self.dispatcher.live

    def begin(self, worlds: list[int], assignments: Sequence[Assignment | None]) -> NDArray[np.int64]:
        """Place the robots of worlds that begin; return their rows."""
        self._live.know_all()
        if self.dispatcher.begins_by_kernel and not any(assignments):
            self.dispatcher.forget(worlds)
            self.dispatcher.begin_by_kernel(sorted(worlds), self._floor)
        else:
            for world, assignment in zip(worlds, assignments, strict=True):
                self.dispatcher.begin(world, None, assignment, self._floor)
        count = self._robots.shape[1]
        rows: NDArray[np.int64] = (np.array(worlds)[:, None] * count + np.arange(count)).ravel()
        return rows

    def give(self, steps: NDArray[np.int64], tensors: dict[str, torch.Tensor]) -> NDArray[np.int64]:
        """Give goals and routes after a step; return the rows of the robots that changed. steps: int64[B]."""
        self._held.copy_(tensors["robots"])
        self.dispatcher.arrive(steps, np.argwhere(self._robots["events"]["arrived"] != 0).tolist())
        self.dispatcher.reroute(steps)
        rows: NDArray[np.int64] = np.flatnonzero(self._live.arrays.changed)
        return rows

    def upload(self, rows: NDArray[np.int64], tensors: dict[str, torch.Tensor]) -> None:
        """Copy robots in rows, their routes and what they have booked to the device."""
        if not len(rows):
            return
        arrays: dict[str, NDArray[Any]] = {"routes": self.dispatcher.routes, "booked": self.dispatcher.booked}
        held = {"robots": self._held} | {name: torch.from_numpy(array) for name, array in arrays.items()}
        device, places = tensors["robots"].device, torch.from_numpy(rows)
        parts = {name: tensor.flatten(0, 1)[places].to(device) for name, tensor in held.items()}
        places = places.to(device)
        for name, part in parts.items():  # after all copies, each of which would wait for a kernel before it
            tensors[name].flatten(0, 1).index_copy_(0, places, part)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return what the worlds need to continue, besides the draws and the robots."""
        arrays = self._live.arrays
        named = {name: array for name, array in arrays.passing._asdict().items() if name != "spread"}
        named |= {"laid": arrays.laid, "cells": arrays.cells, "counts": arrays.counts}
        named |= self.dispatcher.goals._asdict()
        named |= {"routes": self.dispatcher.routes, "booked": self.dispatcher.booked}
        return {f"live.{name}": array for name, array in named.items()}

    def load(self, saved: dict[str, NDArray[Any]]) -> None:
        """Continue from a state."""
        self._live.make_room(saved["live.cells"].shape[2])
        self.dispatcher.make_room(saved["live.routes"].shape[2])
        for name, array in self.state().items():
            held = saved[name]
            array[tuple(map(slice, held.shape))] = held
            if name in ("live.cells", "live.routes"):  # whose width only grows
                array[:, :, held.shape[2] :] = 0
