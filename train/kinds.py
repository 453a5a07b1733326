"""Kinds of robots by share, the fleets of any size that they make, and the options of kinds and of robots' work."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any

from warehouse_env.checked import Checked, CheckedPart, from_plain
from warehouse_env.config import FleetPart, RobotSpec
from warehouse_env.errors import ConfigError
from warehouse_env.files import read_json
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.tasks.orders import make_allocator, note_strays, read_orders
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

_EXAMPLE = '[{"share": 0.25, "robot": {"length": 1.4}}]'
_MOST = 1_000_000  # bytes of a file


@dataclass(frozen=True)
class KindPart(CheckedPart):
    """Robots of one kind."""

    robot: RobotSpec  # their bodies and limits
    share: float  # of however many robots there are

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(0 < self.share <= 1, "share", "a number above 0, up to 1")

    @classmethod
    def upgraded(cls, data: dict[str, Any]) -> dict[str, Any]:
        """Return a stored part without the entry `count`, which older versions left empty beside a share."""
        return {name: value for name, value in data.items() if (name, value) != ("count", None)}

    @property
    def exact_share(self) -> Fraction:
        """The share as it was written, so that ten of 0.1 make 1."""
        return Fraction(str(self.share))


@dataclass(frozen=True)
class Kinds(Checked):
    """The parts of a fleet; the rest are RobotSpec's default kind."""

    parts: tuple[KindPart, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(len(self.parts) > 0, "parts", "at least one")
        together = sum(part.exact_share for part in self.parts)
        if together > 1:
            raise ConfigError(f"the shares make {float(together):g} together, and must make 1 at most")

    @property
    def _shared(self) -> tuple[tuple[RobotSpec, Fraction], ...]:
        """Each kind with its share; RobotSpec's default first, if any is left."""
        left = 1 - sum(part.exact_share for part in self.parts)
        own = ((RobotSpec(), Fraction(left)),) if left else ()
        return (*own, *((part.robot, part.exact_share) for part in self.parts))

    def of(self, robots: int, first: int = 0) -> dict[str, Any]:
        """Return EnvConfig's `robot` and `fleet` for so many robots, from number `first` on in a larger fleet.

        `robot`, by which policies and rules decide, is always the first kind.
        """
        kinds = [robot for robot, _ in self._shared]
        turns = _turns(tuple(share for _, share in self._shared), first + robots)[first:]
        parts = ((turns.count(kind), robot) for kind, robot in enumerate(kinds) if kind)
        return {"robot": kinds[0], "fleet": tuple(FleetPart(count, robot) for count, robot in parts if count)}

    def each(self) -> dict[str, Any]:
        """Return EnvConfig's fields for one robot of each kind, to check what must hold for all."""
        (first, _), *others = self._shared
        fleet = tuple(FleetPart(1, robot) for robot, _ in others)
        return {"robot": first, "fleet": fleet, "num_agents": 1 + len(fleet)}

    @property
    def words(self) -> str:
        """A description of the kinds."""
        shared = self._shared
        if len(shared) == 1:
            return described(shared[0][0])
        texts = [f"{100 * float(share):g}% of {described(robot)}" for robot, share in shared]
        return f"{len(shared)} kinds: {'; '.join(texts)}"


def described(robot: RobotSpec) -> str:
    """Return a short description of a kind."""
    size = f"{robot.length:g} x {robot.width:g} m"
    return f"{size}, up to {robot.max_speed:g} m/s, braking at {robot.max_acceleration:g} m/s²"


@lru_cache(maxsize=4096)
def _turns(shares: tuple[Fraction, ...], robots: int) -> Sequence[int]:
    """Return the kind of each robot: the kind that the robots so far, plus one, lack most of; the first of equals.

    So the counts add up, a larger fleet contains the smaller one, and two kinds are as near to their shares as whole
    robots can be. The method of largest remainders would remove robots of a kind as the fleet grows.
    """
    whole = math.lcm(*(share.denominator for share in shares))
    parts = [int(share * whole) for share in shares]
    lacking, turns = [0] * len(parts), []
    for _ in range(robots):
        lacking = [one + part for one, part in zip(lacking, parts, strict=True)]
        kind = lacking.index(max(lacking))
        lacking[kind] -= whole
        turns.append(kind)
    return tuple(turns)


@dataclass(frozen=True)
class Fleet(Checked):
    """The option for other kinds of robots."""

    fleet: Path | None = None
    """Drive other kinds of robots: a JSON file, as [{"share": 0.25, "robot": {"length": 1.4}}]; "share": 1 changes all
    robots."""

    def kinds(self) -> Kinds | None:
        """Return the kinds of robots; None where all are as RobotSpec has them."""
        return None if self.fleet is None else read_fleet(self.fleet)


def read_fleet(path: Path) -> Kinds:
    """Return the kinds in a file such as [{"share": 0.25, "robot": {"length": 1.4}}]; missing fields are RobotSpec's.

    Raises ConfigError or MapError for a file that cannot be used.
    """
    parts = read_json(path, "fleet", _MOST, ConfigError)
    if not isinstance(parts, list) or not parts:
        raise ConfigError(f"fleet {path} must be a list, as {_EXAMPLE}")
    try:
        return Kinds(tuple(from_plain(KindPart, part) for part in parts))
    except ConfigError as error:
        raise ConfigError(f"fleet {path}: {error}") from None


@dataclass(frozen=True)
class Work(Checked):
    """Options of robots' work; the other fields of EnvConfig's service, orders and battery have their defaults."""

    service: float | None = None
    """Service time at every pick face and station [s] (default: none)."""
    orders: Path | None = None
    """Orders to carry out: a CSV file."""
    orders_per_hour: float | None = None
    """Draw this many random orders per hour instead."""
    allocation: str = OrderSpec.allocation
    """Assignment of orders to robots: nearest, fifo or optimal."""
    battery: bool = False
    """Simulate batteries and charging."""

    def work(self) -> dict[str, Any]:
        """Return the fields of EnvConfig that the options set; ConfigError for a bad file of orders."""
        make_allocator(self.allocation)
        given: dict[str, Any] = {}
        if self.orders is not None and self.orders_per_hour is not None:
            raise ConfigError("--orders-per-hour must be left out with --orders, which says when they come")
        if self.orders is not None:
            read_orders(self.orders)
            given["orders"] = OrderSpec(file=str(self.orders), allocation=self.allocation)
        if self.orders_per_hour is not None:
            given["orders"] = OrderSpec(per_hour=self.orders_per_hour, allocation=self.allocation)
        if self.service is not None:
            given["service"] = ServiceSpec(pick=self.service, station=self.service)
        if self.battery:
            given["battery"] = BatterySpec()
        return given | {"arrival": "stop"} if given else given

    def note_orders(self, grid: GridMap) -> None:
        """Warn of orders to cells of a floor that are neither pick faces nor stations."""
        if self.orders is not None:
            note_strays(read_orders(self.orders), grid)
