"""Notes beside the rows: where on the floor robots wait and collide, and how their trips compare with the plan."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from train.evaluation.rollout import Experiment, centres, pair_centres
from train.reporting.rows import Row, plain
from warehouse_env.simulation.simulator import Simulator

PAGE, NOTES = "index.html", "places.jsonl"  # of a report
KEY = ("policy", "layout", "robots", "tasks", "planner", "seed")  # of an episode, in its row and in its note


class PlaceNotes:
    """A watcher that notes what `Floor` sums up, for every episode of an experiment."""

    def __init__(self, experiment: Experiment) -> None:
        self._experiment = experiment

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Note what happened in the last step; step 0 starts the notes."""
        worlds, (rows, columns) = simulator.num_worlds, simulator.grid.shape
        if not steps:
            self._shape, self._cell = (rows, columns), simulator.grid.cell_size
            self._waited = np.zeros((worlds, rows * columns))
            self._stood = np.zeros(simulator.robots.shape, dtype=np.int64)
            self._contacts: list[list[tuple[float, float, str]]] = [[] for _ in range(worlds)]
            self._seconds = [0.0] * worlds
        else:
            self._note_waiting(simulator)
            self._note_contacts(simulator)
            for world in np.flatnonzero((simulator.robots["task"]["acting"] > 0).any(axis=1)).tolist():
                self._seconds[world] = simulator.seconds(world)

    def _note_waiting(self, simulator: Simulator) -> None:
        """Add the time that each robot stood in the last step to the cell that its body's centre is on."""
        stood = simulator.robots["totals"]["waited"].astype(np.int64)
        world, robot = np.nonzero(stood > self._stood)
        spent = (stood - self._stood)[world, robot] * simulator.config.time_step
        self._stood = stood
        row, column = simulator.grid.nearest_cell(centres(simulator.state.pose, simulator.config)[world, robot]).T
        np.add.at(self._waited, (world, row * self._shape[1] + column), spent)

    def _note_contacts(self, simulator: Simulator) -> None:
        events = simulator.events
        hit = {"shelf": events.hit_shelf > 0, "person": events.hit_person > 0, "robot": events.hit_robot > 0}
        for world in np.flatnonzero(np.any(list(hit.values()), axis=(0, 2))).tolist():
            centre = centres(simulator.state.pose[world], simulator.config)
            found = {kind: centre[of[world]] for kind, of in hit.items()}
            found["robot"] = pair_centres(found["robot"])
            self._contacts[world] += [(*xy, kind) for kind, places in found.items() for xy in places.tolist()]

    def rows(self) -> list[Row]:
        """Return a note of JSON values for each episode, in the order of the seeds."""
        one, config = self._experiment, self._experiment.config
        about = {
            "policy": one.policy, "layout": config.layout, "robots": config.num_agents, "tasks": config.tasks,
            "planner": config.planner,
        }  # fmt: skip
        return [
            dict(plain({
                **about, "seed": seed, "seconds": self._seconds[world], "shape": self._shape, "cell_size": self._cell,
                "waited": [[int(k), round(waited[k], 2)] for k in np.flatnonzero(waited)],
                "contacts": [[round(x, 2), round(y, 2), kind] for x, y, kind in self._contacts[world]],
            }))
            for world, (seed, waited) in enumerate(zip(one.seeds, self._waited, strict=True))
        ]  # fmt: skip


class FloorNotes(NamedTuple):
    """The notes of several episodes on one floor, summed up."""

    waiting: NDArray[np.float64]  # [H, W], seconds per hour that a robot stood there
    contacts: NDArray[np.float64]  # [K, 2] [m]
    hours: float  # simulated


def floor_of_notes(notes: Sequence[Row]) -> FloorNotes:
    """Sum up one or more notes of episodes on one floor."""
    rows, columns = notes[0]["shape"]
    waiting = np.zeros(rows * columns)
    for note in notes:
        for cell, seconds in note["waited"]:
            waiting[cell] += seconds
    hours = sum(note["seconds"] for note in notes) / 3600.0
    contacts = np.array([place[:2] for note in notes for place in note["contacts"]]).reshape(-1, 2)
    return FloorNotes(waiting.reshape(rows, columns) / max(hours, 1e-9), contacts, hours)


def peaks(heat: NDArray[np.float64], count: int, radius: int) -> list[tuple[int, int, float]]:
    """Return up to `count` disjoint squares of the most heat [H, W] as (row, column, heat), hottest first.

    A square reaches `radius` cells from a cell that has heat itself; its heat is the sum of its cells. Of equal squares
    the one with the hotter centre comes first, then the first in reading order.
    """
    left, found = heat.copy(), []
    for _ in range(count):
        squares = sliding_window_view(np.pad(left, radius), (2 * radius + 1, 2 * radius + 1))
        total = np.where(left > 0, squares.sum(axis=(2, 3)), 0.0)
        hottest = np.isclose(total, total.max(), rtol=1e-9)
        row, column = np.unravel_index(int(np.argmax(np.where(hottest, left, -1.0))), heat.shape)
        if not total[row, column] > 0:
            break
        found.append((int(row), int(column), float(total[row, column])))
        left[max(0, row - radius) : row + radius + 1, max(0, column - radius) : column + radius + 1] = 0.0
    return found
