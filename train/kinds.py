"""Kinds of robots by share or count, and the fleets of any size that they make."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

from warehouse_env.checked import Checked, CheckedPart
from warehouse_env.config import FleetPart, RobotSpec
from warehouse_env.errors import ConfigError


@dataclass(frozen=True)
class KindPart(CheckedPart):
    """Robots of one kind: so many of them, or a share of however many robots there are."""

    robot: RobotSpec  # their bodies and limits
    count: int | None = None
    share: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(1, 100_000, "count")
        self._require(self.share is None or 0 < self.share <= 1, "share", "a number above 0, up to 1")
        if (self.count is None) == (self.share is None):
            raise ConfigError('a part says its "count" or its "share", one of the two')

    @property
    def exact_share(self) -> Fraction:
        """The share as it was written, so that ten of 0.1 make 1; 0 where there is none."""
        return Fraction(0) if self.share is None else Fraction(str(self.share))


@dataclass(frozen=True)
class Kinds(Checked):
    """The parts of a fleet, all by count or all by share; the rest are RobotSpec's default kind."""

    parts: tuple[KindPart, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(len(self.parts) > 0, "parts", "at least one")
        if len({part.share is None for part in self.parts}) > 1:
            raise ConfigError('either all parts say "count" or all say "share"')
        together = sum(part.exact_share for part in self.parts)
        if together > 1:
            raise ConfigError(f"the shares make {float(together):g} together, and must make 1 at most")

    @property
    def by_share(self) -> bool:
        """Whether the parts are shares, so that fleets of any size exist."""
        return self.parts[0].share is not None

    @property
    def mixed(self) -> bool:
        """Whether there is more than one kind."""
        return len(self._shared) > 1

    @property
    def _shared(self) -> tuple[tuple[RobotSpec, Fraction], ...]:
        """Each kind with its share, 0 for parts by count; RobotSpec's default first, if any is left."""
        left = 1 - sum(part.exact_share for part in self.parts)
        own = ((RobotSpec(), Fraction(left)),) if left else ()
        return (*own, *((part.robot, part.exact_share) for part in self.parts))

    def of(self, robots: int, first: int = 0) -> dict[str, Any]:
        """Return EnvConfig's `robot` and `fleet` for so many robots, from number `first` on in a larger fleet by share.

        `robot`, by which policies and rules decide, is always the first kind with a share. ConfigError if the parts
        count more robots than there are.
        """
        if not self.by_share:
            counted = sum(part.count or 0 for part in self.parts)
            if counted > robots:
                raise ConfigError(
                    f"the parts of the fleet count {counted:,} robots, and there are {robots:,} in all; give fewer"
                )
            return {"fleet": tuple(FleetPart(part.count or 0, part.robot) for part in self.parts)}
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
        if not self.mixed:
            return described(shared[0][0])
        if self.by_share:
            amounts = [f"{100 * float(share):g}%" for _, share in shared]
        else:
            amounts = ["the others", *(str(part.count) for part in self.parts)]
        texts = [f"{amount} of {described(robot)}" for amount, (robot, _) in zip(amounts, shared, strict=True)]
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
