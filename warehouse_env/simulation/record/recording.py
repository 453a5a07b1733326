"""Episodes as files: everything needed to replay them to the bit, and the poses to show them without a replay.

One compressed file of arrays, without pickle: the config as JSON, the map, the seeds, the actions, the poses.
"""

import contextlib
import dataclasses
import io
import json
import math
import operator
import warnings
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike, NDArray

from warehouse_env import plugins
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WarehouseError, shown
from warehouse_env.files import complete_file, open_regular, zip_member
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.observation import SENSORS
from warehouse_env.simulation.actions import ActionDecoder
from warehouse_env.simulation.given import listed, whole_seed
from warehouse_env.simulation.physics.poses import numbers, within_a_turn
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment, check_assignments
from warehouse_env.simulation.tasks.orders import Order

FORMAT = 1
_ALWAYS = ("occupied", "height", "picks", "stations")  # arrays of a GridMap that every file has
_GOING = ("speed", "price")
_FLOOR = (*_ALWAYS, "one_way", "discs", "walls", *_GOING)  # with those that not every floor has
_LARGEST_FILE = 4_000_000_000  # [bytes]
_LARGEST_ARRAY = 2**30  # [bytes]
_LARGEST_FLOOR = 8 * 10**8  # [bytes] of an array of the map: 10^8 cells
_LONGEST_TEXT = 2**20  # [bytes] of the config and all else that is no array


@dataclass(frozen=True, eq=False)
class Episode:
    """B worlds of N robots over T env steps."""

    config: EnvConfig
    grid: GridMap
    seeds: tuple[int, ...]  # one a world
    actions: NDArray[Any]  # int[T, B, N], preferences uint16[T, B, N, A] (ActionDecoder.shortened), float[T, B, N, 2]
    pose: NDArray[np.float32]  # [T + 1, B, N, 3], front axle x [m], y [m], heading [rad]; the first after the reset
    policy: str = ""  # name or folder of the policy, if known
    orders: tuple[Order, ...] | None = None  # those of the file that the config names
    start: Assignment | None = field(default=None, kw_only=True)  # of the one world, if not drawn by its seed
    made_of: str = field(default="", kw_only=True)  # digest of that policy's weights or code, "" of a shipped one

    def save(self, path: str | Path) -> None:
        """Write a file (.npz), completely or not at all; WarehouseError if it cannot be written."""
        grid = self.grid
        text = {
            "format": FORMAT, "config": self.config.to_dict(), "map": grid.name, "cell_size": grid.cell_size,
            "policy": self.policy, "made_of": self.made_of, "origin": grid.origin, "yaw": grid.yaw,
            "pace": grid.pace,
        }  # fmt: skip
        arrays: dict[str, Any] = {name: array for name in _GOING if (array := getattr(grid, name)) is not None}
        if self.orders is not None:
            arrays["orders"] = np.frombuffer(json.dumps(self.orders, default=np.generic.item).encode(), np.uint8)
        if self.start is not None:
            arrays |= {"start_pose": self.start.pose, "start_goal": self.start.goal}
        if len(grid.discs):
            arrays |= {"discs": grid.discs, "walls": grid.walls}
        with complete_file(path) as part, part.open("wb") as file:
            np.savez_compressed(
                file, about=np.frombuffer(json.dumps(text).encode(), dtype=np.uint8), occupied=grid.occupied,
                height=grid.height, picks=grid.picks, stations=grid.stations, one_way=grid.one_way,
                seeds=np.array(self.seeds, dtype=np.int64), actions=self.actions, pose=self.pose, **arrays,
            )  # fmt: skip

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file of `save`; WarehouseError with one sentence if it is missing, damaged or of another format."""
        with opened(path) as archive:
            return cls._read(archive)

    @classmethod
    def _read(cls, archive: zipfile.ZipFile) -> Self:
        about = json.loads(_array(archive, "about", _LONGEST_TEXT).tobytes())
        if about.get("format") != FORMAT:
            raise WarehouseError(f"it has episode format {shown(about.get('format'))}, not {FORMAT}")
        config, members = EnvConfig.from_dict(about["config"]), archive.namelist()
        floor: dict[str, Any] = {
            name: _array(archive, name) for name in _FLOOR if name in _ALWAYS or f"{name}.npy" in members
        }
        floor |= {name: about[name] for name in ("cell_size", "origin", "yaw", "pace") if name in about}
        grid = GridMap(floor.pop("occupied"), name=about["map"], **floor)
        seeds, actions, pose = (_array(archive, name, _LARGEST_ARRAY) for name in ("seeds", "actions", "pose"))
        _check_shapes(config, seeds, actions, pose)
        orders = _orders(_array(archive, "orders")) if "orders.npy" in members else None
        pose, start = numbers("pose", pose, (-1, -1, -1, 3)), None
        if "start_pose.npy" in members:
            start = Assignment(
                _array(archive, "start_pose", _LARGEST_ARRAY), _array(archive, "start_goal", _LARGEST_ARRAY)
            )
            check_assignments([start], len(seeds), config.num_agents, grid)
        pose[..., 2] = within_a_turn(pose[..., 2])
        return cls(
            config, grid, tuple(seeds.tolist()), actions, pose.astype(np.float32), str(about.get("policy", "")),
            orders, start=start, made_of=str(about.get("made_of", "")),  # which earlier versions did not tell
        )  # fmt: skip

    def replay(self) -> Iterator[Simulator]:
        """Run the episode again: yield the simulator after the reset and after every step."""
        config, extra = self.config, self.config.sensor.extra
        if extra is not None and plugins.parse(extra, "sensor", SENSORS)[0] not in SENSORS:  # only policies need it
            config = config.replace(sensor=dataclasses.replace(config.sensor, extra=None))
        simulator = Simulator(config, len(self.seeds), grid=self.grid, orders=self.orders)
        simulator.reset(self.seeds, None if self.start is None else [self.start])
        yield simulator
        for actions in self.actions:
            simulator.step(actions)
            yield simulator


@contextlib.contextmanager
def opened(path: str | Path) -> Iterator[zipfile.ZipFile]:
    """Yield the archive of an episode's file; WarehouseError if the file, or a member read within, is damaged."""
    with open_regular(path, "episode file", _LARGEST_FILE, WarehouseError) as file:
        try:
            with zipfile.ZipFile(file) as archive, warnings.catch_warnings():
                warnings.simplefilter("ignore")  # NumPy's, of headers as Python 2 wrote them
                yield archive
        except WarehouseError as error:
            raise WarehouseError(f"{path} is no complete episode file: {error}") from None
        except Exception as error:  # NumPy, zip and JSON raise many kinds for damaged bytes
            raise WarehouseError(f"{path} is no complete episode file: {shown(error)}") from None


def _array(archive: zipfile.ZipFile, name: str, most: int = _LARGEST_FLOOR) -> NDArray[Any]:
    """Return an array of plain numbers; an error if it has more than `most` bytes, or fewer than its header claims."""
    file = io.BytesIO(zip_member(archive, f"{name}.npy", most))
    if npy.read_magic(file) != (1, 0):
        raise WarehouseError("it has arrays of an unknown format")
    shape, by_columns, dtype = npy.read_array_header_1_0(file)
    if dtype.kind not in "biuf":
        raise WarehouseError(f"its array {name} of {dtype.name} is not of plain numbers")
    return np.frombuffer(file.read(), dtype).reshape(shape, order="F" if by_columns else "C").copy()


def _orders(text: NDArray[Any]) -> tuple[Order, ...]:
    """Return the orders of a file; an error unless they are of finite numbers and whole cells."""
    orders = []
    for release, picks, drop, due, weight in json.loads(text.tobytes()):
        cells = [(operator.index(row), operator.index(column)) for row, column in (*picks, drop)]
        if len(cells) < 2 or not all(map(math.isfinite, (release, due, weight))):
            raise WarehouseError("its orders need a pick face and a station each, and finite numbers")
        orders.append(Order(float(release), tuple(cells[:-1]), cells[-1], float(due), float(weight)))
    return tuple(orders)


def _check_shapes(config: EnvConfig, seeds: NDArray[Any], actions: NDArray[Any], pose: NDArray[Any]) -> None:
    """Raise WarehouseError unless seeds, actions and poses are of one length and of the config's robots."""
    worlds, robots, steps = seeds.size, config.num_agents, len(actions)
    if seeds.ndim != 1 or not worlds or seeds.dtype.kind not in "iu" or (seeds < 0).any():
        raise WarehouseError(f"the seeds {shown(seeds.tolist())} must be one whole number a world, none negative")
    each: tuple[int, ...] = (2,)
    if config.action_type == "discrete":
        each = (len(config.speed_levels) * len(config.lateral_offsets),) if actions.ndim == 4 else ()
    if steps and actions.shape != (steps, worlds, robots, *each):
        raise WarehouseError(f"actions of shape {actions.shape} do not fit {worlds} worlds of {robots} robots")
    if pose.shape != (steps + 1, worlds, robots, 3) or pose.dtype.kind != "f":
        raise WarehouseError(f"poses of shape {pose.shape} do not fit {steps} steps of {robots} robots")


def recordable(seeds: object) -> tuple[int, ...]:
    """Return one seed a world as Python ints; ConfigError unless a file can hold them."""
    given = listed(seeds)
    if given is None:
        raise ConfigError(f"seeds={shown(seeds)} must be a list of one whole number for each world")
    whole = tuple(whole_seed(seed) for seed in given)
    if any(seed >= 2**63 for seed in whole):
        raise ConfigError(f"seeds={shown(seeds)} must be below 2**63 to be recorded")
    return whole


class Recorder:
    """Step a simulator and keep what an Episode needs. The planner must be the one that the config names."""

    def __init__(
        self, simulator: Simulator, seeds: tuple[int, ...], policy: str = "", start: Assignment | None = None
    ) -> None:
        """Reset the simulator with one seed a world, below 2**63 so that a file can hold them, and begin.

        policy: name or folder of the policy, stored in the episode; start: of a single world.
        """
        self.simulator, self._seeds, self._policy, self._start = simulator, recordable(seeds), policy, start
        simulator.reset(self._seeds, None if start is None else [start])
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
        """The episode recorded so far."""
        simulator = self.simulator
        actions = np.array(self._actions)
        shifts, pose = simulator.dispatcher.shifts, np.array(self._pose)
        orders = None if shifts is None else shifts.orders
        return Episode(
            simulator.config, simulator.grid, self._seeds, actions, pose, self._policy, orders, start=self._start
        )
