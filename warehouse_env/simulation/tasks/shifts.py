"""The shifts of all worlds: what they share (orders, places, limits under load) and their generators.

A load slows a robot down: the drive pulls as hard, and the brakes take up as much, as without it. With a robot of mass
m under a load l, and r = m / (m + l), its acceleration is r times that without load (the same force), and its top speed
sqrt(r) times (the same kinetic energy), so that it stops within the same way. The emergency braking that the shield
counts on is that of the empty robot: brakes are made for the payload.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import ConfigError, shown
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.simulation.draws import Key
from warehouse_env.simulation.state import goal_of
from warehouse_env.simulation.tasks.duty import Batteries
from warehouse_env.simulation.tasks.ledger import Demand, Ledger
from warehouse_env.simulation.tasks.orders import Order, check_orders, read_orders
from warehouse_env.simulation.tasks.placement import Limits
from warehouse_env.simulation.tasks.places import standing_places
from warehouse_env.simulation.tasks.shift import Shift
from warehouse_env.simulation.tasks.tasks import Tasks

_STREAM = 4  # behind the world's own entropy


def check_given(orders: object, config: EnvConfig) -> None:
    """Raise ConfigError for what is no sequence of orders, and where the config has none."""
    if orders is None:
        return
    if not isinstance(orders, Sequence) or not all(isinstance(order, Order) for order in orders):
        raise ConfigError(f"orders={shown(orders)} must be a list of type Order")
    if config.orders is None:
        raise ConfigError("orders that are given need orders=OrderSpec() in the config")


def slowed(robot: RobotSpec, load: float) -> tuple[float, float]:
    """Return (top speed [m/s], acceleration [m/s^2]) under a load [kg]."""
    share = robot.mass / (robot.mass + load)
    return robot.max_speed * math.sqrt(share), robot.max_acceleration * share


def _ways_home(grid: GridMap, chargers: Sequence[Cell]) -> NDArray[np.float64]:
    """Return float64[H, W] [m]: the way from each cell to the nearest charger; inf where there is none."""
    fields = [grid.distance_to(charger) for charger in chargers]
    return np.min(fields, axis=0) * grid.cell_size if fields else np.full(grid.shape, np.inf)


def _check_reach(config: EnvConfig, grid: GridMap, batteries: Batteries, home: NDArray[np.float64]) -> None:
    """Raise ConfigError for batteries with which a robot cannot go from a charger to any place and back."""
    spec = batteries.spec
    way = float(home[tuple(np.array(grid.endpoints[2]).T)].max())
    least = 2 * float(np.max(batteries.needed(way, np.array([robot.payload for robot in config.robots])))) / spec.full
    if spec.capacity < least:
        raise ConfigError(
            f"BatterySpec.capacity={spec.capacity:g} Wh is too little for map {grid.name!r}, where a charger may be "
            f"{way:.0f} m away; give at least {math.ceil(least)}, or more chargers"
        )


class Shifts:
    """A shift for each world, with a random stream of its own."""

    def __init__(
        self, config: EnvConfig, grid: GridMap, tasks: Sequence[Tasks], limits: Limits,
        orders: Sequence[Order] | None,
    ) -> None:  # fmt: skip
        """limits: see placement.py; orders: instead of those that the config names, None: what it says."""
        self._config, self._grid, self._robots = config, grid, config.robots
        named = config.orders.file if config.orders is not None else None
        self.orders = tuple(orders) if orders is not None else None if named is None else read_orders(named)
        if self.orders is not None:
            check_orders(self.orders, grid, config.payload)
        waiting, chargers = self._places(config, grid)
        home = _ways_home(grid, chargers)
        batteries = [Batteries(config, home) if config.battery is not None else None for _ in tasks]
        if batteries and batteries[0] is not None:
            _check_reach(config, grid, batteries[0], home)
        self._each = [
            Shift(config, grid, one, waiting, chargers, battery) for one, battery in zip(tasks, batteries, strict=True)
        ]
        own, shape = limits[0] if limits[1] is None else limits[1], (len(tasks), config.num_agents)
        # PARAMETERS[B, N], by which each robot's path follower drives it; None where nobody carries anything
        self.limits = np.broadcast_to(own, shape).copy() if config.loads else None
        self._rngs: defaultdict[int, np.random.Generator] = defaultdict(np.random.default_rng)

    def __getitem__(self, world: int) -> Shift:
        """Return the shift of a world."""
        return self._each[world]

    @staticmethod
    def _places(config: EnvConfig, grid: GridMap) -> tuple[list[Cell], list[Cell]]:
        """Return the waiting places and the chargers; ConfigError where there is no room for these."""
        chargers = config.battery.chargers if config.battery is not None else 0
        found = standing_places(grid, config, config.num_agents + chargers)
        if len(found) < chargers:
            raise ConfigError(
                f"BatterySpec.chargers={chargers} are too many for map {grid.name!r}: {len(found)} stand beside the "
                "traffic; ask for fewer, or use a floor with wider rims"
            )
        every = max(len(found) // max(chargers, 1), 1)
        charging = found[::every][:chargers]
        return [cell for cell in found if cell not in charging], charging

    def begin(self, world: int, entropy: list[int] | None, key: Key) -> None:
        """Begin a world's episode; entropy: seed of its generator; None: it continues; key: for goals."""
        if entropy is not None:
            self._rngs[world] = np.random.default_rng(np.random.SeedSequence([*entropy, _STREAM]))
        rng, config, ledger = self._rngs[world], self._config, None
        if self.orders is not None:
            ledger = Ledger(self.orders)
        elif config.orders is not None:
            ledger = Ledger(Demand(config.orders, self._grid, config.payload, rng.spawn(1)[0]))
        self._each[world].begin(rng, key, ledger)
        self._put_loads(world, range(config.num_agents))

    def begin_at(self, world: int, robots: NDArray[Any]) -> None:
        """Let a world's robots ROBOT[N] be on the way to the goals that they have, or where that is theirs, at rest."""
        for robot, r in enumerate(robots):
            goal = goal_of(r)
            if goal == tuple(self._grid.cell(np.array([r["motion"]["x"], r["motion"]["y"]])).tolist()):
                r["task"]["alive"] = 0
                self._each[world].stand(robot, goal)
            else:
                self._each[world].assign(robot, goal)

    def go_on(self, world: int, robots: NDArray[Any]) -> dict[int, Cell]:
        """Return the new goals of a world's robots ROBOT[N] (Shift.go_on), and let loads slow them."""
        goals = self._each[world].go_on(robots)
        self._put_loads(world, goals)
        return goals

    def _put_loads(self, world: int, robots: Any) -> None:
        if self.limits is not None:
            for robot in robots:
                own, load = self.limits[world, robot], float(self._each[world].load[robot])
                own["max_speed"], own["max_acceleration"] = slowed(self._robots[robot], load)

    def write_needs(self, observation: NDArray[np.float32], own: slice) -> None:
        """Write the slice `needs` of observations float32[B, N, D]."""
        for world, shift in enumerate(self._each):
            shift.write_needs(observation[world, :, own])
