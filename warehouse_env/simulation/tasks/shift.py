"""A shift: what each robot of one world does next under service times, orders, queues and charging.

A robot drives to a cell that it alone holds, or it stands: in service, at a waiting place, or at a charger. Its state
changes when it arrives, when its service ends, when an order is released, when a cell that it waits for becomes free,
and when its battery is low.

    FREE -> STOP -> SERVED -> STOP ... -> FREE     an order's pick faces and its station, or a drawn goal
            WAITS                                  at a place beside the traffic, for a cell that another holds
    FREE -> RESTS                                  at such a place, for an order
            CHARGER -> CHARGES                     below BatterySpec.low between orders; at once when it is critical

Robots that stand count as parked (`alive` 0): others see them standing, and no rule asks them to leave.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.simulation.draws import Key
from warehouse_env.simulation.tasks.duty import Batteries, Doing, Duty, service_time
from warehouse_env.simulation.tasks.ledger import Ledger, Tally
from warehouse_env.simulation.tasks.orders import make_allocator
from warehouse_env.simulation.tasks.places import Places, nearest_cell
from warehouse_env.simulation.tasks.tasks import Tasks

WINDOW = 64  # open orders that are looked at for an allocation, the oldest
_NO_WAY = 1e12  # [m] for allocators, where no way leads: to them, inf is what is taken
_LOOK = 1.0  # [s] between two looks at the batteries
_ROUNDING = 1e-9  # [s]
_MINUTE = 60.0  # [s] of service beyond which the observation stays the same


class Shift:
    """What the robots of one world do next."""

    def __init__(
        self, config: EnvConfig, grid: GridMap, tasks: Tasks, waiting: Sequence[Cell], chargers: Sequence[Cell],
        batteries: Batteries | None,
    ) -> None:  # fmt: skip
        """waiting, chargers: cells to stand at; batteries: of its robots."""
        self._config, self._grid, self._tasks = config, grid, tasks
        self._waiting, self._chargers = list(waiting), list(chargers)
        self._stations = set(grid.endpoints[1])
        self._step = config.time_step * config.action_repeat  # [s]
        self._allocate_by = make_allocator(config.orders.allocation) if config.orders else None
        self.batteries = batteries
        self.load = np.zeros(config.num_agents)  # [kg]
        self._payloads = np.array([max(robot.payload, 1.0) for robot in config.robots])  # [kg]
        self.begin(np.random.default_rng(), np.zeros(3, np.uint64), None)

    def begin(self, rng: np.random.Generator, key: Key, ledger: Ledger | None) -> None:
        """Begin an episode in which nobody has anything to do; rng: for services, key: for goals."""
        count = self._config.num_agents
        self._rng, self._key, self.ledger = rng, key.copy(), ledger
        self.duties = [Duty() for _ in range(count)]
        self._places = Places(self._waiting, self._grid.endpoints[2])
        self.load[:] = 0.0
        self.carries = np.zeros(count, dtype=np.bool_)
        self._goals: dict[int, Cell] = {}
        self._until = np.full(count, np.inf)  # [s], end of each robot's service
        self._tally = Tally(count)
        self._ticks = -1  # env steps since the reset
        self._looked = self._wake = -math.inf  # [s], of the batteries; of the next event
        if self.batteries is not None:
            self.batteries.begin(rng)

    def assign(self, robot: int, goal: Cell) -> None:
        """Let a robot that has nothing to do drive to a goal, which is work and no order."""
        self._places.take(robot, goal)
        self.duties[robot] = Duty(Doing.STOP, [goal])

    def stand(self, robot: int, cell: Cell) -> None:
        """Let a robot that has nothing to do stand where it is."""
        self._places.take(robot, cell)
        self.duties[robot] = Duty(Doing.RESTS)

    def break_down(self, robot: int) -> None:
        """Stop a robot permanently, and reopen an order that it has not begun."""
        duty, ledger = self.duties[robot], self.ledger
        if ledger is not None and duty.order is not None and not self.carries[robot]:
            ledger.give_back(duty.order)
        if duty.doing not in (Doing.SERVED, Doing.CHARGES):  # else it stands where nobody else is to go
            self._places.leave(robot)
        self.duties[robot], self._until[robot], self._wake = Duty(Doing.BROKEN), math.inf, -math.inf

    def arrive(self, robot: int) -> bool:
        """Let a robot that has reached its goal stand there; return whether that is a stop of its work."""
        duty = self.duties[robot]
        if duty.doing == Doing.STOP:
            at_station = duty.stops[0] in self._stations
            seconds = service_time(self._config.service, at_station, self._rng)
            self._tally.serve(seconds, at_station)
            duty.doing, self._until[robot] = Doing.SERVED, (self._ticks + 1) * self._step + seconds
            self._wake = min(self._wake, float(self._until[robot]))
            return True
        if duty.doing == Doing.CHARGER:
            duty.doing = Doing.CHARGES
        return False

    def go_on(self, robots: NDArray[Any]) -> dict[int, Cell]:
        """Return the goals of those robots ROBOT[N] that are to drive elsewhere now.

        Call it after the reset and after each step, whose time it counts.
        """
        self._ticks += 1
        self._goals, now = {}, self._now
        if self.batteries is not None and now - self._looked >= _LOOK:
            self._looked = now
            self._look_at_batteries(self.batteries, robots)
        if now < self._wake - _ROUNDING:
            return self._goals
        for robot in np.flatnonzero(self._until <= now + _ROUNDING).tolist():
            self._end_service(robot, now, robots)
        if self.ledger is not None:
            self.ledger.release(now)
            self._allocate(self.ledger, robots)
        for robot, cell in self._places.next_in():
            self._head_for(robot, cell, Doing.CHARGER if cell in self._chargers else Doing.STOP)
        for robot, duty in enumerate(self.duties):
            if duty.doing == Doing.FREE:
                self._rest(robot, robots)
        self._wake = min(float(self._until.min()), math.inf if self.ledger is None else self.ledger.next_release)
        return self._goals

    def _look_at_batteries(self, batteries: Batteries, robots: NDArray[Any]) -> None:
        """Discharge and charge. Charged robots continue; robots with a critical charge go to a charger."""
        charging = np.array([duty.doing == Doing.CHARGES for duty in self.duties])
        batteries.use(self._now, robots["totals"]["distance"], self.load, charging)
        share, spec = batteries.share, batteries.spec
        for robot in np.flatnonzero(charging & (share >= spec.full)).tolist():
            self._next(robot)
        critical = batteries.is_critical(self._cells(robots), self.load)
        for robot in np.flatnonzero(critical | (share < spec.low)).tolist():
            duty = self.duties[robot]
            if duty.doing == Doing.RESTS:
                self._go_and_charge(robot)
            if not critical[robot]:
                continue
            if share[robot] <= 0.0 and duty.doing != Doing.CHARGES:
                robots[robot]["task"]["alive"] = 0
                self.break_down(robot)
            elif duty.doing == Doing.STOP or (duty.doing == Doing.WAITS and duty.wants not in self._chargers):
                self._go_and_charge(robot)

    def _end_service(self, robot: int, now: float, robots: NDArray[Any]) -> None:
        """Load or unload, and go on to what is next."""
        duty = self.duties[robot]
        self._until[robot] = math.inf
        cell = duty.stops.pop(0)
        self._tally.drive(robot, float(robots["totals"]["distance"][robot]), bool(self.carries[robot]))
        self._reload(robot, cell)
        if duty.order is not None and not duty.stops:
            assert self.ledger is not None
            self.ledger.complete(duty.order, now)
            duty.order = None
        self._next(robot)

    def _reload(self, robot: int, cell: Cell) -> None:
        """Put on what a stop gives, or take off all at the last one."""
        duty, service = self.duties[robot], self._config.service
        if self.ledger is not None:
            if duty.order is None:  # a goal given by hand
                return
            order = self.ledger.given[duty.order]
            self.load[robot] = self.load[robot] + order.weight / len(order.picks) if duty.stops else 0.0
            self.carries[robot] = bool(duty.stops)
            return
        fetched = cell not in self._stations
        self.carries[robot] = fetched
        self.load[robot] = service.load if fetched and service is not None else 0.0

    def _next(self, robot: int) -> None:
        """Send a robot to what comes next, if that is settled already: charging, or a stop."""
        duty = self.duties[robot]
        duty.doing, self._wake = Doing.FREE, -math.inf
        if self._is_low(robot) and not duty.stops:
            self._go_and_charge(robot)
        elif duty.stops:
            self._head_for(robot, duty.stops[0], Doing.STOP)
        elif self.ledger is None:
            held = self._places.cell_of(robot)
            duty.stops = [self._tasks.next_goal(robot, held, self._key)]
            self._head_for(robot, duty.stops[0], Doing.STOP)

    def _head_for(self, robot: int, cell: Cell, doing: Doing) -> None:
        """Send a robot to a cell, or where another holds it to a place to wait for it."""
        duty = self.duties[robot]
        if cell in self._places.held_by:
            self._wait(robot, cell)
            return
        if duty.doing == Doing.WAITS:
            self._tally.waited += self._now - duty.since
        self._drive(robot, cell, doing)
        duty.wants = None

    def _drive(self, robot: int, cell: Cell, doing: Doing) -> None:
        duty = self.duties[robot]
        self._places.take(robot, cell)
        duty.doing, self._goals[robot] = doing, cell

    def _wait(self, robot: int, cell: Cell) -> None:
        """Put a robot in the queue for a cell; it waits at the place nearest to that, or where it rests already."""
        duty = self.duties[robot]
        if not self._places.stands(robot):
            place = self._places.near(cell)
            if place is not None:
                self._drive(robot, place, Doing.WAITS)
        self._places.queue(robot, cell)
        duty.doing, duty.wants, duty.since = Doing.WAITS, cell, self._now

    def _rest(self, robot: int, robots: NDArray[Any]) -> None:
        """Send a robot that has nothing to do to a free charger, if it can use one, or to a place to stand."""
        duty, batteries = self.duties[robot], self.batteries
        duty.doing = Doing.RESTS
        free = [cell for cell in self._chargers if cell not in self._places.held_by]
        if batteries is not None and free and batteries.share[robot] < batteries.spec.full:
            self._drive(robot, nearest_cell(free, self._cells(robots)[robot]), Doing.CHARGER)
        elif not self._places.stands(robot):
            place = self._places.near(self._cells(robots)[robot])
            if place is not None:
                self._drive(robot, place, Doing.RESTS)

    def _go_and_charge(self, robot: int) -> None:
        """Send a robot to the charger for which the fewest wait."""
        self._wake = -math.inf
        held = self._places.held_by
        charger = min(self._chargers, key=lambda cell: (cell in held) + self._places.queued(cell))
        self._head_for(robot, charger, Doing.CHARGER)

    def _is_low(self, robot: int) -> bool:
        """Whether a robot must charge before it takes on anything else."""
        return self.batteries is not None and bool(self.batteries.share[robot] < self.batteries.spec.low)

    def _allocate(self, ledger: Ledger, robots: NDArray[Any]) -> None:
        """Give open orders whose first pick face is free to idle robots with enough charge."""
        assert self._allocate_by is not None
        idle = (robot for robot, duty in enumerate(self.duties) if duty.doing in (Doing.FREE, Doing.RESTS))
        free = [robot for robot in idle if not self._is_low(robot)]
        if not ledger.open or not free:
            return
        held = self._places.held_by
        numbers = [number for number, order in ledger.open.items() if order.picks[0] not in held][:WINDOW]
        picks = tuple(np.array([ledger.open[number].picks[0] for number in numbers], dtype=np.int64).reshape(-1, 2).T)
        cells = self._cells(robots)
        cost = np.array([self._grid.distance_to(cells[robot])[picks] for robot in free])
        for one, column in self._allocate_by(np.minimum(cost, _NO_WAY)) if numbers else ():
            if ledger.open[numbers[column]].picks[0] not in held and np.isfinite(cost[one, column]):
                robot, order = free[one], ledger.give(numbers[column])
                self.duties[robot].order, self.duties[robot].stops = numbers[column], [*order.picks, order.drop]
                self._head_for(robot, order.picks[0], Doing.STOP)

    def _cells(self, robots: NDArray[Any]) -> list[Cell]:
        """Return the cell from which each robot plans."""
        points = np.stack([robots["motion"]["x"], robots["motion"]["y"]], axis=-1)
        return [(row, column) for row, column in self._grid.standing(points).tolist()]

    def stands_aside(self, robot: int) -> bool:
        """Whether a robot stands at its goal beside the traffic, or will: to wait, rest or charge."""
        return self.duties[robot].doing in (Doing.WAITS, Doing.RESTS, Doing.CHARGER, Doing.CHARGES)

    def at_work(self) -> NDArray[np.bool_]:
        """Return bool[N]: whether a robot that stands will go on."""
        return np.array([duty.doing != Doing.BROKEN for duty in self.duties])

    def needs(self) -> list[dict[str, Any]]:
        """Return what each robot's info says of its work: "doing", "load_kg", and with a battery "charge" [Wh]."""
        rows: list[dict[str, Any]] = [
            {"doing": duty.doing.name.lower(), "load_kg": load}
            for duty, load in zip(self.duties, self.load.tolist(), strict=True)
        ]
        if self.batteries is not None:
            for row, charge in zip(rows, self.batteries.charge.tolist(), strict=True):
                row["charge_wh"] = charge
        return rows

    def write_needs(self, out: NDArray[np.float32]) -> None:
        """Write each robot's own needs into float32[N, K] of the observation (see observation_layout)."""
        served = np.isfinite(self._until)
        out[:, 0] = self.load / self._payloads
        out[:, 1] = served
        out[:, 2] = np.where(served, np.clip(self._until - self._now, 0.0, _MINUTE) / _MINUTE, 0.0)
        if self.batteries is not None:
            out[:, 3] = self.batteries.share

    @property
    def _now(self) -> float:
        """Seconds since the reset."""
        return self._ticks * self._step

    def row(self, robots: NDArray[Any]) -> dict[str, float]:
        """Return the metrics of the shift so far, and of its orders and batteries (Tally, Ledger, Batteries)."""
        now, duties = self._now, self.duties
        served = [(k, duty.stops[0] in self._stations) for k, duty in enumerate(duties) if duty.doing == Doing.SERVED]
        to_come = [(max(float(self._until[robot]) - now, 0.0), at_station) for robot, at_station in served]
        waiting = sum(now - duty.since for duty in duties if duty.doing == Doing.WAITS)
        return {
            **self._tally.row(now, robots["totals"]["distance"], self.carries, to_come, waiting, len(self._stations)),
            **({} if self.ledger is None else self.ledger.row(now)),
            **({} if self.batteries is None else self.batteries.row(now)),
        }
