"""Episodes of chosen worlds of a device, as the files that `warehouse replay` and `audit` take."""

from collections.abc import Sequence

import numpy as np
import torch

from warehouse_env.errors import ConfigError, shown
from warehouse_env.simulation.actions import ActionDecoder
from warehouse_env.simulation.device.memory import field_on_device
from warehouse_env.simulation.device.simulator import DeviceSimulator
from warehouse_env.simulation.given import listed
from warehouse_env.simulation.record.recording import Episode, recordable


class DeviceRecorder:
    """Keep the actions and poses of some worlds. They stay on the device until `episode` is read."""

    def __init__(self, simulator: DeviceSimulator, worlds: Sequence[int], seed: int) -> None:
        """Start the worlds anew, the k-th with the seed `seed + k`, and begin.

        ConfigError for worlds that do not exist or are named twice, and for a seed that no file can hold.
        """
        given, count = listed(worlds) or [], simulator.num_worlds
        if not given or len({world for world in given if world in range(count)}) < len(given):
            raise ConfigError(f"worlds={shown(worlds)} must list some of the {count} worlds, which count from 0, once")
        self.worlds = [int(world) for world in given]
        (first,) = recordable([seed])
        self._seeds = recordable([first + k for k in range(len(given))])
        simulator.reset_worlds(self.worlds, self._seeds)
        self._simulator = simulator
        self._rows = torch.as_tensor(self.worlds, device=simulator.device)
        self._actions = list[torch.Tensor]()
        self._pose = [self._poses()]

    def keep(self, actions: torch.Tensor) -> None:
        """Keep the step that the simulator has just taken by these actions of all worlds."""
        self._actions.append(actions[self._rows])
        self._pose.append(self._poses())

    def _poses(self) -> torch.Tensor:
        robots = self._simulator.robots[self._rows]
        return torch.stack([field_on_device(robots, name) for name in ("x", "y", "heading")], dim=-1)

    @property
    def episode(self) -> Episode:
        """The episode recorded so far; its `save` writes the file."""
        simulator = self._simulator
        decoder = ActionDecoder(simulator.config)
        actions = np.array([decoder.shortened(step.cpu().numpy()) for step in self._actions])
        pose = torch.stack(self._pose).cpu().numpy()
        return Episode(simulator.config, simulator.host.grid, self._seeds, actions, pose)
