"""A solution file as the benchmark's authors write it: statistics, and for each robot the states x, y, yaw and t.

t is in seconds at unit speed; in the authors' files it counts steps of 2.118 s. Between two states a robot drives one
arc of constant curvature at constant speed, forwards or backwards, and turns by less than half a circle; it waits if
they are equal. Before its first state and after its last it stands.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.central.traffic import BEGIN, END, HEADING, X, Y, pose_at
from train.clmapf.instance import LARGEST
from warehouse_env.errors import MapError, shown
from warehouse_env.files import as_number, path_of, write_text
from warehouse_env.maps.plain_yaml import read_yaml

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
