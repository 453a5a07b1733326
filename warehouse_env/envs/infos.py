"""The `info` dict of one robot's last step; lean, because it is built for every robot at every step."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from struct import Struct
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.simulation.record.metrics import people_row, robot_rows
from warehouse_env.simulation.state import OWNER

if TYPE_CHECKING:
    from warehouse_env.simulation.simulator import Simulator
    from warehouse_env.simulation.tasks.tasks import Arrival

EPISODE_METRICS = "episode_metrics"  # the key under which a robot's last info holds its row of metrics
# fields read from a robot's record at every step, in the record's order
_FIELDS = ("driven", "gap", "arrived", "hit_robot", "hit_shelf", "near_miss", "hit_person")


# reward terms and records of robots, arrivals, and each robot's needs
Moment = tuple[bytes, bytes, "list[Arrival]", "list[dict[str, Any]] | None"]


class RobotInfos:
    """Builds the infos of the first robots of a Simulator's first world, from memory that is bound once."""

    def __init__(self, simulator: Simulator, robots: int) -> None:
        """Bind the memory of the first `robots` robots; the Simulator writes its arrays in place."""
        self._simulator, self._count = simulator, robots
        records = simulator.robots[0, :robots]
        terms = simulator.reward_terms[0, :robots]
        # struct turns the records into tuples of Python numbers in half the time of one .tolist() for each field
        self._events, self._events_memory = _struct_of(records.dtype, _FIELDS), _bytes_of(records)
        self._terms, self._terms_memory = Struct(f"{terms.shape[1]}f"), _bytes_of(terms)

    def unread(self, names: dict[str, Any]) -> StepInfos:
        """Return the infos of the last step by robot, the keys of `names`; they are built when read."""
        infos = StepInfos(names)
        infos.unread = self, self.keep()
        return infos

    def keep(self) -> Moment:
        """Return what `read` needs of the last step, for later."""
        shifts, simulator = self._simulator.dispatcher.shifts, self._simulator
        needs = None if shifts is None else shifts[0].needs()
        return self._terms_memory.tobytes(), self._events_memory.tobytes(), simulator.arrivals, needs

    def read(self, moment: Moment) -> list[dict[str, Any]]:
        """Return one fresh dict per robot, of plain Python numbers about a step that was kept.

        "reward_terms": the terms of REWARD_TERMS, weighed, whose sum is the reward; "distance_m": driven, in any
        direction; "goals": goals reached; "collisions_robot", "collisions_shelf", "collisions_person": contact
        episodes that began; "near_misses"; "gap" [m] to the nearest robot, as far as gaps are measured. At an arrival
        also "path_length_m" and "planned_length_m": driven and planned for the finished task. With service, orders or
        batteries also `Shift.needs`. The names are spelled out: that takes half the time of dict(zip()).
        """
        terms, events, arrivals, needs = moment
        infos: list[dict[str, Any]] = [
            {
                "reward_terms": {
                    "progress": progress, "arrival": arrival, "collision": collision, "contact": contact,
                    "proximity": proximity, "time": time, "smoothness": smoothness, "path_length": path_length,
                },
                "distance_m": driven, "goals": arrived, "collisions_robot": hit_robot, "collisions_shelf": hit_shelf,
                "collisions_person": hit_person, "near_misses": near_miss, "gap": gap,
            }
            for (progress, arrival, collision, contact, proximity, time, smoothness, path_length), (
                driven, gap, arrived, hit_robot, hit_shelf, near_miss, hit_person,
            ) in zip(  # noqa: B905 - of one length, and checking it costs time
                self._terms.iter_unpack(terms), self._events.iter_unpack(events)
            )
        ]  # fmt: skip
        for info, need in zip(infos, needs or (), strict=False):
            info |= need
        for arrival in arrivals:
            if arrival.world == 0 and arrival.robot < self._count:
                infos[arrival.robot] |= finished_task(arrival)
        return infos


class StepInfos(dict[str, dict[str, Any]]):
    """The infos of all robots after a step: a dict that is filled on first access.

    Trainers rarely read infos, and building them takes as long as the physics. Copies and pickles are plain dicts.
    """

    __slots__ = ("unread",)
    unread: tuple[RobotInfos, Moment] | None  # their source; None once they are built

    def fill(self) -> None:
        """Build the infos, unless they are built."""
        if self.unread is not None:
            (robot_infos, moment), self.unread = self.unread, None
            self.update(zip(self, robot_infos.read(moment), strict=True))

    def __reduce__(self) -> tuple[type, tuple[dict[str, dict[str, Any]]]]:
        """Be a plain dict elsewhere."""
        return dict, (dict(self),)


def _filled_first(name: str) -> Callable[..., Any]:
    """Return a method of dict that fills the infos first."""
    method = getattr(dict, name)

    def call(self: StepInfos, *arguments: Any, **options: Any) -> Any:
        self.fill()
        return method(self, *arguments, **options)

    return functools.wraps(method)(call)


# all methods that read or change values; without __iter__, `dict(infos)` and `{**infos}` would bypass these
for _name in (
    "__getitem__", "__setitem__", "__delitem__", "__iter__", "__reversed__", "__eq__", "__ne__", "__or__", "__ror__",
    "__ior__", "__repr__", "clear", "copy", "get", "items", "pop", "popitem", "setdefault", "update", "values",
):  # fmt: skip
    setattr(StepInfos, _name, _filled_first(_name))


def finished_task(arrival: Arrival) -> dict[str, float]:
    """Return the extra entries of an arrival's info: metres driven and planned for the finished task."""
    return {"path_length_m": arrival.driven, "planned_length_m": arrival.planned}


def final_metrics(simulator: Simulator, robots: ArrayLike) -> list[dict[str, float]]:
    """Return the metrics of robots whose episode ended with this step.

    They are those of `robot_rows`, and its world's `people_row` and `work_row`.
    robots: int[K], counted over all worlds: world * num_agents + robot.
    """
    chosen = np.asarray(robots)
    config, worlds, persons = simulator.config, chosen // simulator.num_agents, simulator.people.persons
    seconds = simulator.steps[worlds] * config.action_repeat * config.time_step
    rows = robot_rows(simulator.robots.reshape(-1)[chosen], seconds, config)
    work = {world: simulator.dispatcher.work_row(world) for world in set(worlds.tolist())}
    return [known(row | people_row(persons[world]) | work[int(world)]) for row, world in zip(rows, worlds, strict=True)]


def known(row: dict[str, float]) -> dict[str, float]:
    """Return a row without undefined figures (nan), such as the path length of an episode without a goal.

    nan is not equal to itself, which breaks checkers and loggers of other libraries.
    """
    return {name: value for name, value in row.items() if not math.isnan(value)}


def _struct_of(record: np.dtype[Any], fields: tuple[str, ...]) -> Struct:
    """Return a Struct that unpacks some fields of a record, in the record's order, and skips the others."""
    form, end, records = "", 0, dict(record.fields or {})
    for name in fields:
        owner, before = records[OWNER[name]][:2]
        kind, start = owner.fields[name][0], before + owner.fields[name][1]  # type: ignore[index]
        form += f"{start - end}x{kind.char}"
        end = start + kind.itemsize
    return Struct(f"{form}{record.itemsize - end}x")


def _bytes_of(array: NDArray[Any]) -> memoryview:
    """View a contiguous array as bytes."""
    return array.reshape(-1).view(np.uint8).data
