"""Trials, one episode each of a policy's robots on a floor; the plan of an advice, and its clock.

Trials of a seed have the same starts and first goals on floors with the same endpoints, so they pair.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, NamedTuple, Self

from train.evaluation.jobs import Job, Result, Tick
from train.evaluation.places import PlaceNotes
from train.evaluation.rollout import make_experiment, run
from train.job_files import versions
from train.kinds import Kinds
from train.reporting.columns import Measure, field_of
from train.reporting.rows import Row, plain
from warehouse_env import __version__
from warehouse_env.config import EnvConfig
from warehouse_env.errors import counted
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.simulator import Simulator

FELL = 0.9  # of the throughput with fewer robots, below which a floor is jammed


class Aim(NamedTuple):
    """A measure, and how it is read from a trial's row."""

    noun: str
    fell: float  # of the throughput of fewer robots, below which a floor is jammed

    @property
    def late(self) -> Measure:
        """The measure per robot and hour, in the second half of an episode."""
        name = f"late_{self.noun}_per_robot_hour"
        return Measure(name, "late", field_of(name))

    def made(self, row: Row) -> float:
        """Return the throughput of all robots in the second half of an episode, 0 if it has none."""
        return float(row["robots"] * (row[self.late.name] or 0.0))

    def gain(self, row: Row) -> float:
        """Return the measure for changes, per robot and hour of a whole episode."""
        return row[f"{self.noun}_per_robot_hour"] or 0.0


GOALS = Aim("goals", FELL)
ORDERS = Aim("orders", 0.0)  # the number of orders is random, so fewer orders in other episodes do not mean a jam


def orders_of(row: Row, before: float, hours: float) -> Row:
    """Return what `ORDERS` reads, from an episode's row, the orders done by half time and the hours from then on."""
    return {
        "late_orders_per_robot_hour": (row["orders_done"] - before) / hours / row["robots"],
        "orders_per_robot_hour": row["orders_per_hour"] / row["robots"],
    }


BLOCK = 1_000  # seeds of each use, so a choice is confirmed on seeds of their own
AS_IS = "as it is"  # name of the unchanged floor


@dataclass(frozen=True)
class Trial(Job):
    """An episode to be driven."""

    times = ("ms_per_step",)

    floor: str  # its name among those that are tried
    grid: GridMap
    policy: str
    robots: int
    seed: int
    seconds: float
    planner: str
    work: Mapping[str, Any] = field(default_factory=dict)  # fields of EnvConfig: service, orders, battery, robot, fleet

    @property
    def identity(self) -> Row:
        """The fields that identify its row."""
        code = versions(self.policy, self.planner, orders=self._orders_file)  # of user code and orders
        config = EnvConfig(num_agents=self.robots, **self.work).to_dict()
        return {
            "floor": self.floor, "content": f"{self.grid.key} {self.grid.endpoints[2]}", "policy": self.policy,
            "robots": self.robots, "seed": self.seed, "planner": self.planner,
            "asked_seconds": self.seconds, "version": __version__, **({"versions": code} if code else {}),
            "work": plain({name: config[name] for name in self.work}),
        }  # fmt: skip

    @property
    def title(self) -> str:
        """Its robots and their policy, and its floor if that is changed."""
        changed = "" if self.floor == AS_IS else f", {self.floor}"
        return f"{counted(self.robots, 'robot')} · {self.policy}{changed}"

    @property
    def _orders_file(self) -> str:
        orders = self.work.get("orders")
        return "" if orders is None else orders.file or ""

    @property
    def files(self) -> tuple[str, ...]:
        """The policy, the planner and the orders."""
        return self.policy, self.planner, self._orders_file

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Self | None]:
        """Return its row, if there is one."""
        return (rows[:1], None) if rows else ([], self)

    def run(self, tick: Tick) -> Result:
        """Drive an episode; its row also notes where robots waited."""
        env = EnvConfig(num_agents=self.robots, planner=self.planner)
        experiment = make_experiment(self.policy, env, 1, self.seconds, self.seed, self.work)
        places, begin = PlaceNotes(experiment), time.perf_counter()
        half, before = experiment.config.max_steps // 2, dict[str, float]()

        def note_half(simulator: Simulator, steps: int) -> None:
            if steps == half:
                before.update(simulator.episode_metrics(0))

        (row,) = run(experiment, [places, note_half], self.grid)
        (note,) = places.rows()
        if "orders" in self.work:
            rest = (experiment.config.max_steps - half) * env.time_step * experiment.config.action_repeat
            row |= orders_of(row, before["orders_done"], rest / 3600.0)
        kept = {name: value for name, value in {**note, **row}.items() if name not in ("layout", "episode")}
        return Result([kept | self.identity | {"took_s": time.perf_counter() - begin}])


Drive = Callable[[Sequence[Trial]], list[Row]]
"""From trials to their rows."""


class Use(IntEnum):
    """The purpose of episodes; each has seeds of its own."""

    CHOOSE = 0  # between numbers of robots and between policies
    ALONE = 1
    CONFIRM = 2  # the choice
    LOOK = 3  # at changes of the floor
    MEASURE = 4  # the best changes
    ASK = 5  # how many robots reach the target
    ANSWER = 6


@dataclass(frozen=True)
class AdvicePlan:
    """The settings of an advice."""

    grid: GridMap
    policies: tuple[str, ...]  # the first one is used to find the number of robots
    planner: str
    seconds: float  # of an episode
    seed: int
    episodes: int | None  # of everything; None: what the clock allows
    most: int  # robots
    wanted: float | None = None  # goals, or orders, per hour of all robots
    processes: int = 1  # episodes driven at a time
    work: Mapping[str, Any] = field(default_factory=dict)  # fields of EnvConfig: service, orders, battery
    kinds: Kinds | None = None  # of robots, by share; None: RobotSpec
    narrow: tuple[str, ...] = ()  # where their bodies do not fit, a sentence each

    @property
    def aim(self) -> Aim:
        """The measure of the floor."""
        return ORDERS if "orders" in self.work else GOALS

    def trial(self, grid: GridMap, policy: str, robots: int, seed: int, floor: str = AS_IS) -> Trial:
        """Return an episode. A robot alone is of each kind in turn, in proportion to the fleet's shares."""
        turn = (seed - self.seed) % BLOCK if robots == 1 else 0
        return Trial(floor, grid, policy, robots, seed, self.seconds, self.planner, self.given(robots, turn))

    def given(self, robots: int, first: int = 0) -> dict[str, Any]:
        """Return the fields of EnvConfig that robots have; first: see Kinds.of."""
        return {**self.work, **({} if self.kinds is None else self.kinds.of(robots, first))}

    def seeds(self, use: Use, count: int, first: int = 0) -> range:
        """Return seeds of a use, from its number `first` on."""
        begin = self.seed + BLOCK * use + first
        return range(begin, begin + count)

    def at_most(self, episodes: int) -> int:
        """Return the number of episodes to drive if there is time for this many."""
        return episodes if self.episodes is None else self.episodes


class TimeBudget:
    """A budget of time, or none."""

    def __init__(self, minutes: float | None) -> None:
        self.restart()
        self._budget = None if minutes is None else 60.0 * minutes

    def restart(self) -> None:
        """Begin again."""
        self._begin = time.monotonic()

    @property
    def spent(self) -> float:
        """Seconds since it was made, or restarted."""
        return time.monotonic() - self._begin

    @property
    def left(self) -> float:
        """Seconds of the budget that are left, infinite without one."""
        return math.inf if self._budget is None else self._budget - self.spent

    def allows(self, seconds: float, share: float = 1.0) -> bool:
        """Return whether this much more time stays within a share of the budget."""
        return self._budget is None or self.spent + seconds <= share * self._budget
