"""What an `info` dict says about one robot's last step; kept lean, for it is built for every robot at every step."""

from __future__ import annotations

from struct import Struct
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.simulation.record.metrics import robot_rows

if TYPE_CHECKING:
    from warehouse_env.simulation.simulator import Simulator
    from warehouse_env.simulation.tasks.tasks import Arrival

EPISODE_METRICS = "episode_metrics"  # the key under which a robot's last info holds its row of metrics
# what is read of a robot's record at every step, in the record's order
_FIELDS = ("driven", "gap", "arrived", "hit_robot", "hit_shelf", "near_miss", "hit_person")


class RobotInfos:
    """Builds the infos of the first robots of a Simulator's first world, from memory that is bound once."""

    def __init__(self, simulator: Simulator, robots: int) -> None:
        """Bind the memory of the first `robots` robots; the Simulator writes its arrays in place."""
        self._simulator, self._count = simulator, robots
        records = simulator.robots[0, :robots]
        terms = simulator.reward_terms[0, :robots]
        # struct turns the records into tuples of Python numbers in half the time of one .tolist() for each field
        self._events, self._event_bytes = _struct_of(records.dtype, _FIELDS), _bytes_of(records)
        self._terms, self._term_bytes = Struct(f"{terms.shape[1]}f"), _bytes_of(terms)

    def read(self) -> list[dict[str, Any]]:
        """Return one fresh dict per robot, of plain Python numbers about the last step.

        "reward_terms": the terms of REWARD_TERMS, weighed, whose sum is the reward; "distance_m": driven, in any
        direction; "goals": goals reached; "collisions_robot", "collisions_shelf", "collisions_person": contact
        episodes that began; "near_misses"; "gap" [m] to the nearest robot, as far as gaps are measured. At an arrival
        also "path_length_m" and "planned_length_m": driven and planned for the task that it finished.
        The names are spelled out, for a dict written so takes half the time of one zipped together.
        """
        infos: list[dict[str, Any]] = [
            {
                "reward_terms": {
                    "progress": progress,
                    "arrival": arrival,
                    "collision": collision,
                    "contact": contact,
                    "proximity": proximity,
                    "time": time,
                    "smoothness": smoothness,
                    "path_length": path_length,
                },
                "distance_m": driven,
                "goals": arrived,
                "collisions_robot": hit_robot,
                "collisions_shelf": hit_shelf,
                "collisions_person": hit_person,
                "near_misses": near_miss,
                "gap": gap,
            }
            for (progress, arrival, collision, contact, proximity, time, smoothness, path_length), (
                driven, gap, arrived, hit_robot, hit_shelf, near_miss, hit_person,
            ) in zip(  # noqa: B905 - of one length, and checking it costs time
                self._terms.iter_unpack(self._term_bytes), self._events.iter_unpack(self._event_bytes)
            )
        ]  # fmt: skip
        for arrival in self._simulator.arrivals:
            if arrival.world == 0 and arrival.robot < self._count:
                infos[arrival.robot] |= finished_task(arrival)
        return infos


def finished_task(arrival: Arrival) -> dict[str, float]:
    """Return what the info of an arrival says besides: metres driven and planned for the task just finished."""
    return {"path_length_m": arrival.driven, "planned_length_m": arrival.planned}


def final_metrics(simulator: Simulator, robots: ArrayLike) -> list[dict[str, float]]:
    """Return the rows of metrics (`robot_rows`) of robots whose episode has ended with this step.

    robots: int[K], counted over all worlds: world * num_agents + robot.
    """
    chosen = np.asarray(robots)
    config = simulator.config
    seconds = simulator.steps[chosen // simulator.num_agents] * config.action_repeat * config.time_step
    return robot_rows(simulator.robots.reshape(-1)[chosen], seconds, config)


def _struct_of(record: np.dtype[Any], fields: tuple[str, ...]) -> Struct:
    """Return what unpacks some fields of a record, in the record's order, and passes over the others."""
    form, end = "", 0
    for name in fields:
        kind, start = record.fields[name][:2]  # type: ignore[index]
        form += f"{start - end}x{kind.char}"
        end = start + kind.itemsize
    return Struct(f"{form}{record.itemsize - end}x")


def _bytes_of(array: NDArray[Any]) -> memoryview:
    """View a contiguous array as bytes."""
    return array.reshape(-1).view(np.uint8).data
