"""The benchmark's files: instances (start and goal poses, discs), why one may be impossible as stated, and solutions.

The benchmark's frame is left-handed: forward is (cos yaw, -sin yaw). Here headings are -yaw at the same x and y.

A solution has statistics, and for each robot the states x, y, yaw and t, in seconds at unit speed; in the authors'
files t counts steps of 2.118 s. Between two states a robot drives one arc of constant curvature at constant speed,
forwards or backwards, and turns by less than half a circle; it waits if they are equal. Before its first state and
after its last it stands.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.central.floor import CarBody
from train.central.traffic import BEGIN, END, HEADING, X, Y, pose_at
from train.evaluation.audit.bodies import Outline, gap, point_gap
from warehouse_env.errors import MapError, shown
from warehouse_env.files import as_number, path_of, write_text
from warehouse_env.maps.halls.map_server import read_yaml

BODY = CarBody(ahead=2.0, behind=1.0, half_width=1.0, radius=3.0)
DISC_RADIUS = 0.8
NO_DISC = (-1.0, -1.0)  # in a file without obstacles
LARGEST = 8 * 2**20  # [bytes] of an instance or a solution; 100 robots need half a million
_MOST, _WIDEST = 1000, 4000.0  # robots, and the floor's side

Poses = NDArray[np.float64]  # [N, 3]: x, y and heading


@dataclass(frozen=True)
class Instance:
    """An instance."""

    name: str
    width: float
    height: float
    names: tuple[str, ...]  # of the robots
    starts: Poses
    goals: Poses
    discs: NDArray[np.float64]  # [K, 2]


def middle_of(pose: Sequence[float] | NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return the centre of the body at a pose, and its cosine and sine."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ahead = 0.5 * (BODY.ahead - BODY.behind)
    return float(pose[0] + ahead * c), float(pose[1] + ahead * s), c, s


def disc_gap(pose: NDArray[np.float64], disc: NDArray[np.float64]) -> float:
    """Return how far a body is from a disc, negative where they overlap."""
    x, y, c, s = middle_of(pose)
    dx, dy = float(disc[0]) - x, float(disc[1]) - y
    return float(point_gap(dx * c + dy * s, dy * c - dx * s, BODY.half_length, BODY.half_width)) - DISC_RADIUS


def body_gap(pose: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return how far two bodies are apart, negative where they overlap."""
    half = BODY.half_length, BODY.half_width
    return float(gap(Outline(*middle_of(pose), *half), Outline(*middle_of(other), *half)))


def gaps(instance: Instance) -> Iterator[tuple[float, str]]:
    """Yield the gap of each start and goal to each disc and to the others, and a sentence for a negative one."""
    for what, poses in (("start", instance.starts), ("goal", instance.goals)):
        for name, pose in zip(instance.names, poses, strict=True):
            for k, disc in enumerate(instance.discs):
                found = disc_gap(pose, disc)
                yield found, f"the {what} of {name} overlaps obstacle {k} by {-found:.3f}"
        for (i, pose), (j, other) in itertools.combinations(enumerate(poses), 2):
            yield body_gap(pose, other), f"the {what}s of {instance.names[i]} and {instance.names[j]} overlap"


def why_impossible(instance: Instance) -> Iterator[str]:
    """Yield what no route can solve: poses with the axle off the floor, or that overlap discs or each other."""
    for what, poses in (("start", instance.starts), ("goal", instance.goals)):
        inside = ((poses[:, :2] >= 0.0) & (poses[:, :2] <= (instance.width, instance.height))).all(axis=1)
        yield from (f"the {what} of {instance.names[i]} is off the floor" for i in np.flatnonzero(~inside).tolist())
    yield from (text for found, text in gaps(instance) if found < 0.0)


def read_instance(path: Path, name: str) -> Instance:
    """Read a file of the benchmark; MapError if it is wrong."""
    data = read_yaml(path_of(path, MapError), "instance", LARGEST)
    agents, floor = _member(data, "agents", list, path), _member(data, "map", dict, path)
    width, height = _numbers(_member(floor, "dimensions", list, path), 2, "dimensions", path)
    if not (0.0 < width <= _WIDEST and 0.0 < height <= _WIDEST):
        raise MapError(f"{path}: dimensions [{width}, {height}] must lie between 0 and {_WIDEST}")
    if not 1 <= len(agents) <= _MOST:
        raise MapError(f"{path} has {len(agents)} agents; between 1 and {_MOST} can be read")
    names = tuple(_name(agent, path) for agent in agents)
    if len(set(names)) < len(names):
        raise MapError(f"{path} names two agents alike")
    starts, goals = (_poses(agents, what, path) for what in ("start", "goal"))
    discs = [_numbers(disc, 2, "obstacles", path) for disc in _member(floor, "obstacles", list, path)]
    kept = np.array([disc for disc in discs if disc != NO_DISC], np.float64).reshape(-1, 2)
    return Instance(name, width, height, names, starts, goals, kept)


def _member(data: Any, key: str, kind: type, path: Path) -> Any:
    """Return a member, which must be a list or a dict; an empty one is an empty list."""
    found = data.get(key) if isinstance(data, dict) else None
    if found is None and kind is list and isinstance(data, dict) and key in data:
        return []
    if not isinstance(found, kind):
        raise MapError(f"{path} has no {key}, so it is no instance of the benchmark")
    return found


def _numbers(given: Any, count: int, what: str, path: Path) -> tuple[float, ...]:
    found = [as_number(value) for value in given] if isinstance(given, list) else []
    if len(found) != count or not all(map(math.isfinite, found)):
        raise MapError(f"{path}: {what} {shown(given)} must be {count} numbers")
    return tuple(found)


def _name(agent: Any, path: Path) -> str:
    name = agent.get("name") if isinstance(agent, dict) else None
    if not isinstance(name, str):
        raise MapError(f"{path} has an agent without a name")
    return name


def _poses(agents: list[Any], what: str, path: Path) -> Poses:
    poses = np.array([_numbers(agent.get(what), 3, what, path) for agent in agents], np.float64)
    if np.abs(poses).max() > 10 * _WIDEST:
        raise MapError(f"{path}: a {what} lies too far off")
    poses[:, 2] *= -1.0
    return poses


_KEYS = ("x", "y", "yaw", "t")
_FARTHEST = 1e6  # of a coordinate or time that is read
_STEP = 2.0  # [s] between two states, at most
States = NDArray[np.float64]  # [K, 4]: x, y, heading, t


def read_solution(path: Path) -> dict[str, States]:
    """Return the states of each robot by its name; MapError if the file is wrong."""
    data = read_yaml(path_of(path, MapError), "solution", LARGEST)
    schedule = data.get("schedule") if isinstance(data, dict) else None
    if not isinstance(schedule, dict) or not schedule:
        raise MapError(f"{path} has no schedule, so it is no solution of the benchmark")
    return {str(name): _states(rows, str(name), path) for name, rows in schedule.items()}


def _states(rows: Any, name: str, path: Path) -> States:
    if not isinstance(rows, list) or not rows:
        raise MapError(f"{path}: {name} has no states")
    found = []
    for row in rows:
        found.append([as_number(row.get(key)) for key in _KEYS] if isinstance(row, dict) else [math.nan])
        if not all(abs(value) <= _FARTHEST for value in found[-1]):
            raise MapError(f"{path}: {name} has a state {shown(row)}, where x, y, yaw and t must be numbers")
    states = np.array(found, np.float64)
    states[:, 2] *= -1.0
    return states


def states_of(route: NDArray[np.float64]) -> States:
    """Return the states of a route float64[K, PIECE] of the planner; long pieces are split, so that arcs are unique."""
    states = [route[0, [X, Y, HEADING, BEGIN]].tolist()]
    for n, piece in enumerate(route):
        seconds = piece[END] - piece[BEGIN]
        parts = max(1, int(np.ceil(seconds / _STEP))) if seconds > 0.0 else 0
        for k in range(1, parts + 1):
            t = piece[BEGIN] + seconds * k / parts
            states.append([*pose_at(route[None], 0, n, t), t])
    return np.array(states)


def write_solution(path: Path, names: Sequence[str], routes: Sequence[NDArray[np.float64]], seconds: float) -> None:
    """Write the routes of all robots; seconds: of the planner."""
    ends = [float(route[-1, END]) for route in routes]
    flowtime, makespan = sum(ends), max(ends)
    lines = ["statistics:", f"  cost: {flowtime:.9g}", f"  makespan: {makespan:.9g}", f"  flowtime: {flowtime:.9g}"]
    lines += [f"  runtime: {seconds:.6g}", "schedule:"]
    for name, route in zip(names, routes, strict=True):
        lines.append(f"  {name}:")
        for x, y, heading, t in states_of(route).tolist():
            lines += [f"    - x: {x:.9f}", f"      y: {y:.9f}", f"      yaw: {0.0 - heading:.9f}", f"      t: {t:.9f}"]
    write_text(path, "\n".join(lines) + "\n")
