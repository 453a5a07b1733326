"""A world that can be changed while it runs: its simulator, its policy and its totals.

The same setting with the same commands at the same steps gives the same bits, at any pace and with any pages.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import POLICIES, Actor
from train.evaluation.rollout import POLICY_STREAM, config_of, make_actor
from train.kinds import Kinds
from train.live.commands import Leave, Make, Person, Shelves
from train.live.floors import LiveFloors, free_cell, with_shelves
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WarehouseError, unknown_name
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.replay import moment_of, places, station_cells
from warehouse_env.simulation.physics.people import START
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import PERSON_RADIUS
from warehouse_env.simulation.tasks.assignment import Assignment

Change = Make | Shelves | Person | Leave
Moment = dict[str, NDArray[Any]]
"""The visible state of a world: see replay.moment_of."""


@dataclass(frozen=True)
class WorldSetting:
    """How a world begins."""

    policy: str
    floor: str
    robots: int
    people: int
    seed: int
    planner: str = EnvConfig.planner
    chosen: Mapping[str, Any] = dataclasses.field(default_factory=dict)  # fields of EnvConfig
    kinds: Kinds | None = None  # of robots; None: RobotSpec

    @property
    def given(self) -> dict[str, Any]:
        """Fields of EnvConfig besides those that the policy needs."""
        return {**self.chosen, **({} if self.kinds is None else self.kinds.of(self.robots))}


class World:
    """One world and its policy; `change` replaces it, or raises and leaves it as it is."""

    def __init__(self, setting: WorldSetting, floors: LiveFloors) -> None:
        self.floors = floors
        self.made = 0  # simulators so far
        self._begin(setting)

    def _begin(self, setting: WorldSetting) -> None:
        """Restart; nothing is changed if that raises."""
        grid = self.floors.load(setting.floor)
        simulator, act = _made(setting, setting.people, grid)
        simulator.reset([setting.seed])
        self.setting, self.bare = setting, grid
        self._rng = np.random.default_rng([setting.seed, POLICY_STREAM])
        self.steps, self._time = 0, 0.0
        self._before = np.zeros(3, dtype=np.int64)  # totals of earlier simulators
        self._digest = hashlib.blake2b(digest_size=16)
        self._take(simulator, act)

    def _take(self, simulator: Simulator, act: Actor) -> None:
        self.simulator, self._act = simulator, act
        self._stations = station_cells(simulator.grid)
        self.made += 1
        self._note()

    @property
    def grid(self) -> GridMap:
        """The current floor."""
        return self.simulator.grid

    @property
    def seconds(self) -> float:
        """Simulated time since the world began [s]."""
        return round(self._time, 6)

    @property
    def step_seconds(self) -> float:
        """Simulated time of a step [s]."""
        config = self.simulator.config
        return config.action_repeat * config.time_step

    @property
    def digest(self) -> str:
        """A digest of all poses at all steps so far, 32 hex digits."""
        return self._digest.hexdigest()

    def step(self) -> Moment:
        """Let all robots decide once; return the moment after."""
        simulator = self.simulator
        simulator.step(self._act(simulator.observation, self._rng))
        self.steps += 1
        self._time += self.step_seconds
        self._note()
        return self.moment()

    def _note(self) -> None:
        self._digest.update(self.simulator.state.pose.tobytes())

    def moment(self) -> Moment:
        """Return the current moment; totals count on while the world continues."""
        moment = moment_of(self.simulator, 0, self._stations)
        moment["totals"] = (moment["totals"] + self._before).astype(np.int32)
        return moment

    def change(self, change: Change) -> bool:
        """Change the world; return whether it restarted. Raises WarehouseError if that is refused."""
        if isinstance(change, Make):
            return self._make(change)
        if isinstance(change, Shelves):
            self._shelve(change)
        elif isinstance(change, Person):
            self._stand_person(free_cell(self.grid, change.cell))
        else:
            self._dismiss(change.person)
        return False

    def _make(self, asked: Make) -> bool:
        given = {name: value for name, value in dataclasses.asdict(asked).items() if value is not None}
        if asked.policy is not None and asked.policy not in {*POLICIES, self.setting.policy}:
            raise unknown_name("policy", asked.policy, POLICIES)  # pages cannot name folders
        setting = dataclasses.replace(self.setting, **given)
        if given.keys() == {"policy"}:
            self._go_on(setting, self.grid, self._places())
            return False
        self._begin(dataclasses.replace(setting, people=len(self._places())))
        return True

    def _shelve(self, asked: Shelves) -> None:
        grid = with_shelves(self.grid, asked.cells, asked.stand, self.bare)
        if asked.stand:
            centres = grid.centre(np.array(asked.cells))
            beside = np.abs(self._places()[:, None] - centres).max(axis=2)
            if (beside < grid.cell_size / 2 + PERSON_RADIUS).any():
                raise ConfigError("somebody stands there; shelves need cells without people")
        try:
            self._go_on(self.setting, grid, self._places())
        except WarehouseError as error:
            raise ConfigError(f"no shelf can stand there now: {error}") from error

    def _stand_person(self, cell: tuple[int, int]) -> None:
        point = self.grid.centre(np.array(cell))
        pose = self.simulator.state.pose[0]
        near = np.hypot(pose[:, 0] - point[0], pose[:, 1] - point[1])
        if near.min() < START:
            raise ConfigError(f"robot {int(near.argmin())} is within {START:g} m of there")
        self._go_on(self.setting, self.grid, np.concatenate([self._places(), point[None]]))

    def _dismiss(self, person: int) -> None:
        points = self._places()
        if not 0 <= person < len(points):
            raise ConfigError(f"there is no person {person} among {len(points)}")
        self._go_on(self.setting, self.grid, np.delete(points, person, axis=0))

    def _places(self) -> NDArray[np.float32]:
        """Return float32[M, 2], the positions of people [m]."""
        return places(self.simulator.people.persons[0])[:, :2]

    def _go_on(self, setting: WorldSetting, grid: GridMap, people: NDArray[np.floating[Any]]) -> None:
        """Continue with another policy, floor or people: robots keep pose, speed and goal, and get new routes.

        Robots that could not stop before a new shelf are stopped at once, so a click causes no contact.
        """
        old = self.simulator
        simulator, act = _made(setting, len(people), grid)
        if setting.policy == self.setting.policy:
            act.memory = self._act.memory
        pose, speed, goal = (values.copy() for values in (old.state.pose, old.state.speed, old.state.goal))
        speed[0, _too_fast(pose[0], speed[0], grid.centre(np.argwhere(grid.occupied & ~old.grid.occupied)), old)] = 0
        assignment = Assignment(pose[0].astype(np.float64), goal[0])
        simulator.reset_to([assignment], [_seed(setting.seed, self.made)])
        if len(people):
            simulator.people.stand(0, people)
        simulator.put(pose, speed)
        simulator.state.steer[...] = old.state.steer  # `put` sets it to 0, but the shield needs it
        self._before = self.moment()["totals"].astype(np.int64)
        self.setting = setting
        self._take(simulator, act)


def _made(setting: WorldSetting, people: int, grid: GridMap) -> tuple[Simulator, Actor]:
    """Return a simulator to be reset, and its actor."""
    base = EnvConfig(num_agents=setting.robots, planner=setting.planner, layout=setting.floor)
    config = config_of(setting.policy, base, {**setting.given, "people": people})
    return Simulator(config, grid=grid), make_actor(setting.policy, config)


def _too_fast(
    pose: NDArray[np.float32], speed: NDArray[np.float32], shelves: NDArray[np.float64], simulator: Simulator
) -> NDArray[np.bool_]:
    """Return bool[N]: whether robots might touch one of the shelves float[K, 2] [m] before they stop."""
    config = simulator.config
    step = config.action_repeat * config.time_step
    farthest, brake = np.array([(robot.farthest, robot.max_acceleration) for robot in config.robots]).T
    beside = np.abs(pose[:, None, :2] - shelves) - simulator.grid.cell_size / 2
    gap = np.hypot(*np.moveaxis(np.maximum(beside, 0.0), -1, 0)).min(axis=1, initial=np.inf)  # from the front axle
    fast = np.abs(speed)
    return np.asarray(gap < farthest + fast * step + fast**2 / (2 * brake))


def _seed(seed: int, made: int) -> int:
    """Return the seed of the tasks after the change number `made`."""
    return int(np.random.SeedSequence([seed, made]).generate_state(1)[0])
