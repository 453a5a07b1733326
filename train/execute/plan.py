"""Plans of grid planners: a cell for each robot at each step, read from the files of other projects and checked.

Formats, told apart by their content:

- output of the League of Robot Runners (JSON: `start`, `actualPaths` of F, R, C, W; `events` are finished tasks);
- a line a step, as pypibt and lacam write it: `12:(x,y),(x,y),...`;
- a line a robot, as CBS, EECBS, MAPF-LNS2 and PBS write it: `Agent 3: (row,column)->(row,column)->...`; SMART adds the
  step to each cell: `Agent 3:(row,column,0)->(row,column,1)->...`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import PlanError, counted, shown
from warehouse_env.files import parsed_json, read_text
from warehouse_env.maps.grid_map import Cell, GridMap

LARGEST = 2**28  # [bytes] of a file
_MOST = 10_000, 1_000_000  # robots, and steps
_STEP = re.compile(r"(\d+):((?:\(\d+,\d+\),?)+)")
_AGENT = re.compile(r"Agent(\d+):((?:\(\d+,\d+(?:,\d+)?\)(?:->)?)+)")
_BEGUN = re.compile(r"\d+:|Agent")  # such a line; headers are passed over
_CELL = re.compile(r"\((\d+),(\d+)(?:,(\d+))?\)")
_TURNS = {"E": (0, 1), "S": (1, 0), "W": (0, -1), "N": (-1, 0)}  # clockwise, as (row, column)
_ACTIONS = {"F": 0, "R": 1, "C": -1, "W": 0, "T": 0}  # quarters clockwise


class GridPlan(NamedTuple):
    """A plan of N robots over T steps."""

    cells: NDArray[np.int64]  # [T + 1, N, 2], (row, column)
    tasks: tuple[tuple[int, ...], ...]  # steps after which each robot has finished a task

    @property
    def makespan(self) -> int:
        """The step after which no robot moves any more."""
        moving = np.flatnonzero((self.cells != self.cells[-1]).any(axis=(1, 2)))
        return int(moving[-1]) + 1 if len(moving) else 0


def path_of(cells: NDArray[np.int64]) -> tuple[list[Cell], list[int]]:
    """Return the cells of a robot's plan int[T + 1, 2] without its waits, and the step after which it is at each."""
    moved = np.flatnonzero((np.diff(cells, axis=0) != 0).any(axis=1)) + 1
    steps = [0, *moved.tolist()]
    return [(row, column) for row, column in cells[steps].tolist()], steps


def read_plan(path: Path, grid: GridMap) -> GridPlan:
    """Read a plan for a floor; PlanError, naming step and robots, if it is none or breaks the rules of grid plans."""
    text = read_text(path, "plan", LARGEST, PlanError)
    if text.lstrip().startswith("{"):
        plan = _league(parsed_json(text, str(path), PlanError), path)
    else:
        lines = "".join(text.split(" ")).splitlines()
        for number, line in enumerate(lines, start=1):
            if _BEGUN.match(line) and not (_STEP.fullmatch(line) or _AGENT.fullmatch(line)):
                raise PlanError(f"{path}, line {number}: {shown(line[:40])} is neither a step nor a robot's path")
        steps = [found for line in lines if (found := _STEP.fullmatch(line))]
        agents = [found for line in lines if (found := _AGENT.fullmatch(line))]
        plan = _by_steps(steps, path) if steps else _by_agents(agents, path)
    try:
        check_plan(plan.cells, grid)
    except PlanError as error:
        raise PlanError(f"{path}: {error}") from None
    return plan


def _by_steps(found: Sequence[re.Match[str]], path: Path) -> GridPlan:
    numbers = [int(line[1]) for line in found]
    configurations = [[(int(y), int(x)) for x, y, _ in _CELL.findall(line[2])] for line in found]
    if numbers != list(range(len(numbers))) or len(set(map(len, configurations))) != 1:
        raise PlanError(f"{path}: steps must be numbered from 0 on, each with a cell of every robot")
    return finished(np.array(configurations, np.int64))


def _by_agents(found: Sequence[re.Match[str]], path: Path) -> GridPlan:
    if not found:
        raise PlanError(
            f"{path} is no plan: neither the League of Robot Runners' JSON, nor lines '0:(x,y),(x,y),' of steps, nor "
            "lines 'Agent 0: (row,column)->(row,column)->' of robots"
        )
    cells = [_CELL.findall(line[2]) for line in found]
    if any(step not in ("", str(t)) for path in cells for t, (*_, step) in enumerate(path)):
        raise PlanError(f"{path}: the steps of each robot must follow each other from 0 on")
    paths = [[(int(row), int(column)) for row, column, _ in path] for path in cells]
    if [int(line[1]) for line in found] != list(range(len(found))):
        raise PlanError(f"{path}: robots must be numbered from 0 on")
    most = max(map(len, paths))
    return finished(np.array([[path[min(t, len(path) - 1)] for path in paths] for t in range(most)], np.int64))


def finished(cells: NDArray[np.int64]) -> GridPlan:
    """Return the plan of one task for each robot, at its last cell."""
    robots = range(cells.shape[1])
    return GridPlan(cells, tuple((path_of(cells[:, i])[1][-1],) for i in robots))


def _league(data: Any, path: Path) -> GridPlan:
    try:
        actions = [text.split(",") if text else [] for text in data["actualPaths"]]
        starts = [(int(row), int(column), "ESWN".index(facing)) for row, column, facing in data["start"]]
        cells = [list(_driven(start, own)) for start, own in zip(starts, actions, strict=True)]
        tasks: list[list[int]] = [[] for _ in cells]
        for step, robot in _finishes(data.get("events", [])):
            tasks[robot].append(int(step))
    except (KeyError, ValueError, TypeError, IndexError, AttributeError):
        raise PlanError(
            f"{path} is JSON without `start` and `actualPaths` as the League of Robot Runners' output has them"
        ) from None
    if len(set(map(len, cells))) != 1:
        raise PlanError(f"{path}: `actualPaths` must have as many actions for each robot")
    plan = GridPlan(np.array(cells, np.int64).transpose(1, 0, 2), tuple(map(tuple, tasks)))
    return plan if any(tasks) else finished(plan.cells)


def _finishes(events: Sequence[Any]) -> Iterator[tuple[int, int]]:
    """Yield (step, robot) of finished tasks: events of 2024, [step, robot, task, part], or of 2023, a list a robot."""
    for robot, event in enumerate(events):
        if all(isinstance(one, int) for one in event) and event:
            yield event[0], event[1]
        else:
            yield from ((step, robot) for _, step, told in event if told == "finished")


def _driven(start: tuple[int, int, int], actions: Sequence[str]) -> Iterator[Cell]:
    """Yield the cells of a robot that turns on the spot, at first and after each action."""
    row, column, facing = start
    yield row, column
    for action in actions:
        facing = (facing + _ACTIONS[action]) % 4
        if action == "F":
            row, column = row + _TURNS["ESWN"[facing]][0], column + _TURNS["ESWN"[facing]][1]
        yield row, column


def check_plan(cells: NDArray[np.int64], grid: GridMap) -> None:
    """Raise PlanError unless robots move to free cells beside theirs, and no two share or swap cells."""
    steps, robots = len(cells) - 1, cells.shape[1]
    if not 1 <= robots <= _MOST[0] or steps > _MOST[1]:
        raise PlanError(f"{counted(robots, 'robot')} over {steps:,} steps; at most {_MOST[0]:,} over {_MOST[1]:,}")
    inside = np.asarray(((cells >= 0) & (cells < grid.shape)).all(axis=2))
    closed = grid.closed[tuple(np.where(inside[..., None], cells, 0).transpose(2, 0, 1))]
    for step, robot in np.argwhere(np.logical_or(~inside, closed))[:1].tolist():
        raise PlanError(f"step {step}: robot {robot} is at {_at(cells, step, robot)}, which is no free cell")
    for step, robot in np.argwhere(np.abs(np.diff(cells, axis=0)).sum(axis=2) > 1)[:1].tolist():
        moved = f"from {_at(cells, step, robot)} to {_at(cells, step + 1, robot)}"
        raise PlanError(f"step {step + 1}: robot {robot} moves {moved}, which is not beside it")
    places = cells[..., 0] * grid.shape[1] + cells[..., 1]
    for step, now in enumerate(places):
        where = {place: robot for robot, place in reversed(list(enumerate(now.tolist())))}
        if len(where) < robots:
            robot = next(robot for robot, place in enumerate(now.tolist()) if where[place] != robot)
            other = where[int(now[robot])]
            raise PlanError(f"step {step}: robots {other} and {robot} are both at {_at(cells, step, robot)}")
        if step == 0:
            continue
        for robot in np.flatnonzero(places[step - 1] != now).tolist():
            other = where.get(int(places[step - 1, robot]))
            if other is not None and other != robot and places[step - 1, other] == now[robot]:
                raise PlanError(f"step {step}: robots {robot} and {other} swap cells")


def _at(cells: NDArray[np.int64], step: int, robot: int) -> str:
    return shown(tuple(cells[step, robot].tolist()))
