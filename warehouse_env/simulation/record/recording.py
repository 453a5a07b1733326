"""Episodes as files: what is needed to run them again to the bit, and the poses to show them without running.

One compressed file of arrays, without pickle: the config as JSON, the map, the seeds, the actions, the poses.
"""

from __future__ import annotations

import contextlib
import json
import math
import warnings
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike, NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WarehouseError, shown
from warehouse_env.files import complete_file, open_regular
from warehouse_env.maps.discs import MOST
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.actions import ActionDecoder
from warehouse_env.simulation.given import listed, whole_seed
from warehouse_env.simulation.physics.poses import numbers, within_a_turn
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.orders import Order, as_table, from_table

FORMAT = 1
_ALWAYS = ("height", "picks", "stations")  # arrays of a GridMap that every file has,
_GOING = ("speed", "price")  # and that not every floor has
_LARGEST_FILE = 4_000_000_000  # [bytes]
_LONGEST_TEXT = 2**20  # [bytes] of the config and all else that is no array
_MOST_CELLS = 10**8  # of a floor
_MOST_ENTRIES = 2**28  # of any array


@dataclass(frozen=True, eq=False)
class Episode:
    """B worlds of N robots over T env steps."""

    config: EnvConfig
    grid: GridMap
    seeds: tuple[int, ...]  # one a world
    actions: NDArray[Any]  # int[T, B, N], preferences uint16[T, B, N, A] (ActionDecoder.shortened), float[T, B, N, 2]
    pose: NDArray[np.float32]  # [T + 1, B, N, 3], front axle x [m], y [m], heading [rad]; the first after the reset
    policy: str = ""  # name or folder of what chose the actions, if it was told
    orders: tuple[Order, ...] | None = None  # those of the file that the config names
    made_of: str = field(default="", kw_only=True)  # digest of that policy's weights or code, "" of a shipped one

    def save(self, path: str | Path) -> None:
        """Write to a file (.npz), as a whole or not at all; WarehouseError where it cannot be written."""
        grid = self.grid
        text = {
            "format": FORMAT, "config": self.config.to_dict(), "map": grid.name, "cell_size": grid.cell_size,
            "policy": self.policy, "made_of": self.made_of, "origin": grid.origin, "pace": grid.pace,
        }  # fmt: skip
        arrays: dict[str, Any] = {name: array for name in _GOING if (array := getattr(grid, name)) is not None}
        if self.orders is not None:
            arrays["orders"] = np.array(as_table(self.orders), dtype=np.float64)
        if len(grid.discs):
            arrays |= {"discs": grid.discs, "walls": grid.walls}
        with complete_file(path) as part, part.open("wb") as file:
            np.savez_compressed(
                file, about=np.frombuffer(json.dumps(text).encode(), dtype=np.uint8), occupied=grid.occupied,
                height=grid.height, picks=grid.picks, stations=grid.stations, one_way=grid.one_way,
                seeds=np.array(self.seeds, dtype=np.int64), actions=self.actions, pose=self.pose, **arrays,
            )  # fmt: skip

    @classmethod
    def load(cls, path: str | Path) -> Episode:
        """Read a file of `save`; WarehouseError with one sentence if it is missing, damaged or of another format."""
        with opened(path) as archive:
            return cls._read(_Arrays(archive))

    @classmethod
    def _read(cls, arrays: _Arrays) -> Episode:
        """Read an episode. Shapes and sizes are checked before any large array is inflated."""
        about = json.loads(arrays.read("about", most=_LONGEST_TEXT).tobytes())
        if about.get("format") != FORMAT:
            raise WarehouseError(f"it has episode format {shown(about.get('format'))}, not {FORMAT}")
        config, policy = EnvConfig.from_dict(about["config"]), str(about.get("policy", ""))
        _check_shapes(config, *(arrays.header(name) for name in ("seeds", "actions", "pose")))
        cells = arrays.read("occupied", most=_MOST_CELLS)
        many = {"height": 1, "picks": 2, "stations": 2, "one_way": 1, "walls": 1, **dict.fromkeys(_GOING, 8)}  # a cell
        most = {name: count * cells.size for name, count in many.items()} | {"discs": 3 * MOST}
        floor: dict[str, Any] = {
            name: arrays.read(name, count) for name, count in most.items() if name in arrays or name in _ALWAYS
        }
        floor |= {name: about[name] for name in ("cell_size", "origin", "pace") if name in about}
        grid = GridMap(cells, name=about["map"], **floor)
        seeds = tuple(arrays.read("seeds").tolist())
        if not all(isinstance(seed, int) and seed >= 0 for seed in seeds):
            raise WarehouseError(f"the seeds {shown(seeds)} must be one whole number a world, none negative")
        orders = from_table(arrays.read("orders").tolist()) if "orders" in arrays else None
        pose = numbers("pose", arrays.read("pose"), (-1, -1, -1, 3))
        pose[..., 2] = within_a_turn(pose[..., 2])
        made_of = str(about.get("made_of", ""))  # which earlier versions did not tell
        return cls(
            config, grid, seeds, arrays.read("actions"), pose.astype(np.float32), policy, orders, made_of=made_of
        )

    def replay(self) -> Iterator[Simulator]:
        """Run the episode again: yield the simulator after the reset and after every step."""
        simulator = Simulator(self.config, len(self.seeds), grid=self.grid, orders=self.orders)
        simulator.reset(self.seeds)
        yield simulator
        for actions in self.actions:
            simulator.step(actions)
            yield simulator


@contextlib.contextmanager
def opened(path: str | Path) -> Iterator[zipfile.ZipFile]:
    """Yield the archive of an episode's file; WarehouseError where it, or what is read of it within, is damaged."""
    with open_regular(path, "episode file", _LARGEST_FILE, WarehouseError) as file:
        try:
            with zipfile.ZipFile(file) as archive, warnings.catch_warnings():
                warnings.simplefilter("ignore")  # NumPy's, of headers as Python 2 wrote them
                yield archive
        except WarehouseError as error:
            raise WarehouseError(f"{path} is no complete episode file: {error}") from None
        except Exception as error:  # NumPy, zip and JSON raise a dozen kinds where bytes are not what they were
            raise WarehouseError(f"{path} is no complete episode file: {shown(error)}") from None


Header = tuple[tuple[int, ...], np.dtype[Any]]  # of an array: its shape and kind


class _Arrays:
    """The arrays of an .npz file. A few kilobytes may claim gigabytes, so each is asked what it will be before."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive

    def __contains__(self, name: str) -> bool:
        return f"{name}.npy" in self._archive.namelist()

    def header(self, name: str) -> Header:
        """Return what an array will be; ValueError for a format that NumPy does not write for plain numbers."""
        with self._archive.open(f"{name}.npy") as file:
            if npy.read_magic(file) != (1, 0):
                raise ValueError("it has arrays of an unknown format")
            shape, _, dtype = npy.read_array_header_1_0(file)
            return shape, dtype

    def read(self, name: str, most: int = _MOST_ENTRIES) -> NDArray[Any]:
        """Return an array; WarehouseError if it has more than `most` entries, or other than numbers."""
        shape, dtype = self.header(name)
        if dtype.kind not in "biuf" or math.prod(shape) > most:
            raise WarehouseError(f"its array {name} of {dtype.name}{list(shape)} is not what such a file holds")
        with self._archive.open(f"{name}.npy") as file:
            return np.asarray(npy.read_array(file, allow_pickle=False))


def _check_shapes(config: EnvConfig, *headers: Header) -> None:
    """Raise WarehouseError unless seeds, actions and poses are of one length and of the config's robots."""
    (seeds, _), (actions, _), (pose, kind) = headers
    worlds, robots = seeds[0] if len(seeds) == 1 else 0, config.num_agents
    steps = actions[0] if actions else 0
    each: tuple[int, ...] = (2,)
    if config.action_type == "discrete":
        liked = len(config.speed_levels) * len(config.lateral_offsets)
        each = (liked,) if len(actions) == 4 else ()
    if not worlds:
        raise WarehouseError(f"seeds of shape {seeds} are not one or more, one a world")
    if steps and actions != (steps, worlds, robots, *each):
        raise WarehouseError(f"actions of shape {actions} do not fit {worlds} worlds of {robots} robots")
    if pose != (steps + 1, worlds, robots, 3) or kind.kind != "f":
        raise WarehouseError(f"poses of shape {pose} do not fit {steps} steps of {robots} robots")


class Recorder:
    """Steps a simulator and keeps what an Episode needs. The planner must be the one that the config names."""

    def __init__(self, simulator: Simulator, seeds: tuple[int, ...], policy: str = "") -> None:
        """Reset the simulator with one seed a world, below 2**63 so that a file can hold them, and begin.

        policy: the name or folder of what will choose the actions, to be told with the episode.
        """
        given = listed(seeds)
        if given is None:
            raise ConfigError(f"seeds={shown(seeds)} must be a list of one whole number for each world")
        self.simulator, self._seeds, self._policy = simulator, tuple(whole_seed(seed) for seed in given), policy
        if any(seed >= 2**63 for seed in self._seeds):
            raise ConfigError(f"seeds={shown(seeds)} must be below 2**63 to be recorded")
        simulator.reset(self._seeds)
        self._decoder = ActionDecoder(simulator.config)
        self._actions: list[NDArray[Any]] = []
        self._pose = [simulator.state.pose.copy()]

    def step(self, actions: ArrayLike) -> NDArray[np.float32]:
        """Step the simulator and keep the actions and poses; returns the observation."""
        observation = self.simulator.step(actions)
        self._actions.append(self._decoder.shortened(actions))
        self._pose.append(self.simulator.state.pose.copy())
        return observation

    @property
    def episode(self) -> Episode:
        """What has been recorded so far."""
        simulator = self.simulator
        actions = np.array(self._actions)
        shifts, pose = simulator.dispatcher.shifts, np.array(self._pose)
        orders = None if shifts is None else shifts.orders
        return Episode(simulator.config, simulator.grid, self._seeds, actions, pose, self._policy, orders)
