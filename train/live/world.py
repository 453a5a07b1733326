"""A world that a page may replace (its floor, its simulator and its policy), and the commands of a page, checked.

The same setting gives the same bits, at any pace and with any pages.
"""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents import POLICIES
from train.evaluation.rollout import POLICY_STREAM, Experiment, config_of, decider
from train.kinds import Kinds
from warehouse_env.checked import Checked, check_names, from_plain
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, check_known, shown, unknown_name
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.render.replay import moment_of
from warehouse_env.simulation.simulator import Simulator

MOST_BYTES = 65_536  # of a message
MOST_ROBOTS = 256
SLOWEST, FASTEST = 0.25, 1000.0  # simulated seconds a second


@dataclass(frozen=True)
class Play(Checked):
    """Play or pause."""

    playing: bool


@dataclass(frozen=True)
class Speed(Checked):
    """Set the pace: simulated seconds a second; None: as fast as possible."""

    speed: float | None
    ranges: ClassVar = {"speed": (SLOWEST, FASTEST)}


@dataclass(frozen=True)
class Step(Checked):
    """Pause, after one more decision of the robots."""


@dataclass(frozen=True)
class Make(Checked):
    """Restart with another policy, floor, number of robots or seed."""

    policy: str | None = None
    floor: str | None = None
    robots: int | None = None
    seed: int | None = None
    ranges: ClassVar = {"robots": (1, MOST_ROBOTS), "seed": (0, 2**53)}  # whole numbers of a page


Command = Play | Speed | Step | Make
COMMANDS: dict[str, type[Command]] = {"play": Play, "speed": Speed, "step": Step, "make": Make}


def read_command(message: bytes) -> Command:
    """Return the command of a message such as {"do": "play", "playing": true}; ConfigError if it is wrong."""
    if len(message) > MOST_BYTES:
        raise ConfigError(f"a message has at most {MOST_BYTES:,} bytes, not {len(message):,}")
    try:
        data = json.loads(message)
    except (ValueError, RecursionError):  # no UTF-8, no JSON, or brackets without end
        raise ConfigError("a message must be a JSON object") from None
    if not isinstance(data, dict) or not isinstance(data.get("do"), str):
        raise ConfigError(f'a message must be a JSON object that says what to "do", not {shown(data)}')
    name = data.pop("do")
    check_known("command", [name], COMMANDS)
    kind = COMMANDS[name]
    check_names(f"{name} parameter", data, kind)
    return from_plain(kind, data)


Moment = dict[str, NDArray[Any]]
"""The visible state of a world: see replay.moment_of."""


@dataclass(frozen=True)
class WorldSetting:
    """How a world begins."""

    policy: str
    floor: str
    robots: int
    seed: int
    planner: str = EnvConfig.planner
    chosen: Mapping[str, Any] = dataclasses.field(default_factory=dict)  # fields of EnvConfig
    kinds: Kinds | None = None  # of robots; None: RobotSpec

    @property
    def given(self) -> dict[str, Any]:
        """Fields of EnvConfig besides those that the policy needs."""
        return {**self.chosen, **({} if self.kinds is None else self.kinds.of(self.robots))}


def live_floors(layout: str) -> dict[str, str]:
    """Return the floors that pages may choose, by name: the first one, which may be a file's, and all named layouts."""
    return {Path(layout).name: layout} | {name: name for name in LAYOUTS}


class World:
    """One world and its policy."""

    def __init__(self, setting: WorldSetting, floors: Mapping[str, str]) -> None:
        """floors: layouts by the names that settings use (live_floors)."""
        self.floors = floors
        self.made = 0  # simulators so far
        self.begin(setting)

    def begin(self, setting: WorldSetting) -> None:
        """Start a new world; if that raises, nothing changes."""
        check_known("floor", [setting.floor], self.floors)
        base = EnvConfig(num_agents=setting.robots, planner=setting.planner, layout=setting.floor)
        config = config_of(setting.policy, base, setting.given)
        simulator = Simulator(config, grid=make_layout(self.floors[setting.floor]))
        decide = decider(Experiment(setting.policy, config, setting.seed, episodes=(0,)))
        simulator.reset([setting.seed])
        self.setting, self.simulator, self._decide = setting, simulator, decide
        self._rng = np.random.default_rng([setting.seed, POLICY_STREAM])
        self.steps = 0
        self._stations = simulator.grid.marked(simulator.grid.stations)
        self.made += 1

    @property
    def grid(self) -> GridMap:
        """The current floor."""
        return self.simulator.grid

    @property
    def seconds(self) -> float:
        """Simulated time since the world began [s]."""
        return round(self.steps * self.step_seconds, 6)

    @property
    def step_seconds(self) -> float:
        """Simulated time of a step [s]."""
        config = self.simulator.config
        return config.action_repeat * config.time_step

    def step(self) -> Moment:
        """Let all robots decide once; return the moment after."""
        simulator = self.simulator
        simulator.step(self._decide(simulator, [self._rng]))
        self.steps += 1
        return self.moment()

    def moment(self) -> Moment:
        """Return the current moment."""
        return moment_of(self.simulator, 0, self._stations)

    def make(self, asked: Make) -> None:
        """Start a new world with another setting; if that is refused, raise WarehouseError and keep this one."""
        if asked.policy is not None and asked.policy not in {*POLICIES, self.setting.policy}:
            raise unknown_name("policy", asked.policy, POLICIES)  # pages cannot name folders
        given = {name: value for name, value in dataclasses.asdict(asked).items() if value is not None}
        self.begin(dataclasses.replace(self.setting, **given))
