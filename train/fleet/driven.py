"""The episode of a real fleet, its file, and its figures as a row like that of an evaluation.

It cannot be run again, since its vehicles' commands are unknown; poses and orders are shown as stored. The file is one
of `warehouse record` with empty actions, and further members of the archive hold the orders.
"""

import json
import math
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.fleet.figures import LOADED, MOMENT, PRESENT, SILENT, FleetFigures
from train.reporting.report import Table, number
from train.reporting.rows import Row, plain
from warehouse_env import __version__
from warehouse_env.errors import WarehouseError
from warehouse_env.files import complete_file, zip_member
from warehouse_env.render.replay import REWARD_TERMS
from warehouse_env.simulation.record.metrics import episode_row
from warehouse_env.simulation.record.recording import Episode, opened
from warehouse_env.simulation.state import NOBODY, PERSON, events_of, state_of
from warehouse_env.simulation.traffic.waits import Jams

_ABOUT, _MOMENTS, _COUNTS, _POINTS = "fleet.json", "fleet.moments", "fleet.counts", "fleet.points"
_LONGEST_TEXT = 2**24  # [bytes]
MOST_POINTS = 5_000_000  # of all lines
_COUNT, _POINT = np.dtype("<i4"), np.dtype("<f4")


@dataclass(frozen=True, eq=False)
class FleetEpisode(Episode):
    """One world of N vehicles over T steps of time_step."""

    moments: NDArray[Any] = None  # type: ignore[assignment]  # MOMENT[T + 1, N]
    lines: tuple[NDArray[np.float32], ...] = ()  # each [K, 2] [m], of the orders
    vehicles: tuple[str, ...] = ()  # as MANUFACTURER/SERIAL
    begin: str = ""  # of the first moment, UTC
    notes: tuple[str, ...] = ()  # what was left out, and what is unknown

    def save(self, path: str | Path) -> None:
        """Write to a file (.npz), completely or not at all."""
        about = {"vehicles": self.vehicles, "begin": self.begin, "notes": self.notes}
        members = {
            _ABOUT: json.dumps(about).encode(),
            _MOMENTS: np.ascontiguousarray(self.moments).tobytes(),
            _COUNTS: np.array([len(line) for line in self.lines], _COUNT).tobytes(),
            _POINTS: np.concatenate(self.lines).astype(_POINT).tobytes(),
        }
        with complete_file(path) as part:
            super().save(part)
            with zipfile.ZipFile(part, "a", zipfile.ZIP_DEFLATED) as archive:
                for name, content in members.items():
                    archive.writestr(name, content)

    def replay(self) -> Iterator[Any]:
        """Yield a stand-in for the simulator at each moment."""
        shown = FleetPlayback(self)
        for pose, moment in zip(self.pose[:, 0], self.moments, strict=True):
            shown.take(pose, moment)
            yield shown


class FleetPlayback(FleetFigures):
    """The parts of a simulator that pages and pictures use, for a fleet that is not simulated."""

    def __init__(self, driven: FleetEpisode) -> None:
        super().__init__(driven.config)
        self.config, self.grid, self._lines = driven.config, driven.grid, driven.lines
        count = driven.config.num_agents
        self.state, self.events = state_of(self.robots), events_of(self.robots)
        self.routes = np.zeros((1, count, max(map(len, driven.lines)), 2), np.float32)
        self.people = SimpleNamespace(persons=np.zeros((1, 0), PERSON))
        self.reward_terms = np.zeros((1, count, len(REWARD_TERMS)), np.float32)
        self.dispatcher = SimpleNamespace(shifts=(self,))
        self.carries = self.silent = self._present = np.zeros(count, np.bool_)
        self._line = np.full(count, -1)

    def take(self, pose: NDArray[np.float32], moment: NDArray[Any]) -> None:
        """Take the next moment."""
        super().take(pose, moment)
        robots = self.robots[0]
        self.state.pose[0] = pose
        robots["task"]["goal_row"], robots["task"]["goal_col"] = np.divmod(moment["goal"], self.grid.shape[1])
        self.carries, self.silent, self._present = ((moment["bits"] & bit) != 0 for bit in (LOADED, SILENT, PRESENT))
        for i in np.flatnonzero(moment["line"] != self._line).tolist():
            line = self._lines[moment["line"][i]]
            self.routes[0, i, : len(line)] = line
            robots["on_route"]["points"][i] = len(line)
        self._line = moment["line"].copy()

    def at_work(self) -> NDArray[np.bool_]:
        """Return bool[N]: which vehicles are present."""
        return np.asarray(self._present)

    def jams(self) -> Jams:
        """Return no waits: messages do not hold the wait-for graph."""
        return Jams(*(np.full(self.robots.shape, NOBODY, np.int32) for _ in range(3)))

    def episode_metrics(self, world: int = 0) -> dict[str, float]:
        """Return the metrics so far."""
        return episode_row(self.robots[0], self.seconds(), self.config)


def load_episode(path: str | Path) -> Episode:
    """Read an episode's file, of `warehouse record` or `warehouse fleet --listen`; WarehouseError as Episode.load."""
    episode = Episode.load(path)
    with opened(path) as archive:
        return _driven(episode, archive) if _ABOUT in archive.namelist() else episode


def load_simulated(path: str | Path) -> Episode:
    """Read an episode that can be run again; WarehouseError for one of a real fleet."""
    episode = load_episode(path)
    if isinstance(episode, FleetEpisode):
        raise WarehouseError(f"{path} is of a real fleet, which cannot be run again; `warehouse replay` shows it")
    return episode


def _driven(episode: Episode, archive: zipfile.ZipFile) -> FleetEpisode:
    """Return the episode with its further members, each checked before it is used."""
    about = json.loads(zip_member(archive, _ABOUT, _LONGEST_TEXT))
    frames, worlds, robots, _ = episode.pose.shape
    size = frames * robots * MOMENT.itemsize
    moments = np.frombuffer(zip_member(archive, _MOMENTS, size), MOMENT)
    counts = np.frombuffer(zip_member(archive, _COUNTS, _COUNT.itemsize * MOST_POINTS), _COUNT)
    points = np.frombuffer(zip_member(archive, _POINTS, 2 * _POINT.itemsize * MOST_POINTS), _POINT).reshape(-1, 2)
    if worlds != 1 or len(moments) != frames * robots:
        raise WarehouseError(f"its {len(moments)} moments are not those of {frames} times {robots} vehicles")
    if not len(counts) or counts.min() < 1 or counts.sum(dtype=np.int64) != len(points):
        raise WarehouseError("its lines have other points than it says")
    good = (moments["goal"] >= 0) & (moments["goal"] < episode.grid.occupied.size)
    good &= (moments["line"] >= 0) & (moments["line"] < len(counts))
    if not good.all() or not np.isfinite(points).all() or not np.isfinite(episode.pose).all():
        raise WarehouseError("some of its goals, lines or poses are out of range")
    lines = tuple(np.split(points.astype(np.float32), np.cumsum(counts)[:-1]))
    return FleetEpisode(
        episode.config, episode.grid, episode.seeds, episode.actions, episode.pose, episode.policy, None,
        moments.reshape(frames, robots), lines, tuple(map(str, about["vehicles"])), str(about["begin"]),
        tuple(map(str, about["notes"])),
    )  # fmt: skip


_COLUMNS = (
    ("seconds", "s"), ("robot_km", "km"), ("goals", "goals"), ("goals_per_robot_hour", "goals/robot-h"),
    ("waiting_share", "waiting %"), ("near_misses", "near misses"), ("collisions_robot", "contacts"),
    ("min_clearance_m", "least gap m"), ("path_length_ratio", "driven/planned"),
    ("longest_standing_s", "longest standing s"),
)  # fmt: skip
_NOTE = (
    "Figures of a fleet come from its messages. Goals are finished orders (only those with an action, if any vehicle "
    "reports actions). Waiting is standing with an order to drive. Gaps are between bodies at the reported positions. "
    "Planned lengths are straight from node to node of an order when first seen. Contacts between robots are overlaps, "
    "or errors that two adjacent vehicles report; contacts with shelves and people are only reported errors."
)


def row_of(episode: FleetEpisode, source: object, moved: Callable[[], object] = lambda: None) -> Row:
    """Return a fleet's row; moved: called after each moment. Reroutes are None, since no message tells them."""
    for last in episode.replay():
        moved()
        shown = last
    config = episode.config
    row = {
        "policy": "fleet", "layout": config.layout, "robots": config.num_agents, "tasks": config.tasks,
        "planner": config.planner, "source": str(source), "seed": episode.seeds[0], **shown.episode_metrics(0),
        "config": config.to_dict(), "version": __version__, "reroutes": math.nan, "notes": list(episode.notes),
        "vehicles": list(episode.vehicles),
    }  # fmt: skip
    return dict(plain(row))


def fleet_table(row: Row) -> Table:
    """Return the table of a fleet's figures, and notes on what they leave out."""
    values = ((row.get(name), 100.0 if name == "waiting_share" else 1.0) for name, _ in _COLUMNS)
    cells = tuple("-" if value is None else number(scale * value, 4) for value, scale in values)
    noted = "".join(f"\nNote: {note}." for note in row["notes"])
    header = ("robots", *(heading for _, heading in _COLUMNS))
    return Table("Fleet", header, ((str(row["robots"]), *cells),), _NOTE + noted)
