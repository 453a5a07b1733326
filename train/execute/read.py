"""Files of plans, by other projects. Their formats are told apart by their content:

- output of the League of Robot Runners (JSON): `start`, `actualPaths` of F, R, C, W, in 2026 as runs of equal actions,
  of which `agentMaxCounter` make a move; `events` are finished tasks;
- the MAPF Tracker (CSV with a column `solution_plan` or `path`): a line of u, d, l, r, w for each robot of a scenario;
- a line a step, as pypibt and lacam write it: `12:(x,y),(x,y),...`;
- a line a robot, as CBS, EECBS, MAPF-LNS2 and PBS write it: `Agent 3: (row,column)->(row,column)->...`; SMART adds the
  step to each cell: `Agent 3:(row,column,0)->(row,column,1)->...`.
"""

import csv
import io
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.execute.plan import GridPlan, check_plan, finished
from warehouse_env.errors import PlanError, shown
from warehouse_env.files import parsed_json, read_text
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.movingai import read_scen

LARGEST = 2**28  # [bytes] of a file
_MOST_ACTIONS = 100_000_000  # of all robots, since runs of actions are short texts
_STEP = re.compile(r"(\d{1,9}):((?:\(\d{1,9},\d{1,9}\),?)+)")
_AGENT = re.compile(r"Agent(\d{1,9}):((?:\(\d{1,9},\d{1,9}(?:,\d{1,9})?\)(?:->)?)+)")
_BEGUN = re.compile(r"\d+:|Agent")  # such a line; headers are passed over
_CELL = re.compile(r"\((\d+),(\d+)(?:,(\d+))?\)")
_RUN = re.compile(r"([FRCW]) (\d{1,7})")
_SEGMENTS = re.compile(rf"(?:\[\(\d+(?:,\d+){{4}}\):\((?:{_RUN.pattern},?)*\)\])+")
_TURNED = {"F": 0, "R": 1, "C": -1, "W": 0, "T": 0}  # quarters clockwise
_FACING = {"E": (0, 1), "S": (1, 0), "W": (0, -1), "N": (-1, 0)}  # clockwise, as (row, column)
_MOVES = {"u": (1, 0), "d": (-1, 0), "l": (0, -1), "r": (0, 1), "w": (0, 0)}
_COLUMNS = "solution_plan", "path"  # of the MAPF Tracker's files


def read_plan(path: Path, grid: GridMap, scen: Path | None = None) -> GridPlan:
    """Read a plan for a floor; PlanError, naming step and robots, if it is none or breaks the rules of grid plans.

    scen: the scenarios of a plan of the MAPF Tracker, which holds no starts; MapError if these cannot be read.
    """
    text = read_text(path, "plan", LARGEST, PlanError)
    columns = [name.strip('"') for name in text.partition("\n")[0].strip().split(",")]
    if any(name in columns for name in _COLUMNS):
        plan = _tracked(text, path, scen)
    elif scen is not None:
        raise PlanError(f"{path} is no plan of the MAPF Tracker: leave out --scen {scen}")
    elif text.lstrip().startswith("{"):
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
    return finished(_together(paths))


def _together(paths: Sequence[Sequence[Cell]]) -> NDArray[np.int64]:
    """Return int[T + 1, N, 2] of paths of which the shorter ones wait at their ends."""
    most = max(map(len, paths))
    return np.array([[path[min(t, len(path) - 1)] for path in paths] for t in range(most)], np.int64)


def _tracked(text: str, path: Path, scen: Path | None) -> GridPlan:
    csv.field_size_limit(LARGEST)
    try:
        rows = list(csv.DictReader(io.StringIO(text.rstrip() + "\n", newline="")))
    except csv.Error as error:
        raise PlanError(f"{path} is no table of comma-separated values ({error})") from None
    if len(rows) != 1:
        raise PlanError(f"{path} holds {len(rows)} plans: keep its heading and the row of one plan")
    if scen is None:
        raise PlanError(f"{path} holds moves without starts: name their scenarios with --scen FILE.scen")
    lines = next((rows[0][name] or "" for name in _COLUMNS if name in rows[0]), "").split()
    tasks = read_scen(scen)[: len(lines)]
    if not 1 <= len(lines) <= len(tasks):
        raise PlanError(f"{path} has moves of {len(lines)} robots, {scen} starts of {len(tasks)}")
    for robot, line in enumerate(lines):
        if wrong := set(line) - set(_MOVES):
            raise PlanError(f"{path}: robot {robot} makes the move {shown(min(wrong))}, which is none of u, d, l, r, w")
    for up in (1, -1):  # published plans count rows upwards, the site's own example downwards: the goals tell
        paths = [list(_moved(task.start, line, up)) for task, line in zip(tasks, lines, strict=True)]
        if all(cells[-1] == task.goal for cells, task in zip(paths, tasks, strict=True)):
            return finished(_together(paths))
    raise PlanError(f"{path}: its moves do not lead the robots from their starts to their goals in {scen}")


def _moved(start: Cell, moves: str, up: int) -> Iterator[Cell]:
    """Yield the cells of a robot, at first and after each of the moves; up: rows of a move u."""
    row, column = start
    yield start
    for move in moves:
        row, column = row + up * _MOVES[move][0], column + _MOVES[move][1]
        yield row, column


def _league(data: Any, path: Path) -> GridPlan:
    try:
        ticks, paths = int(data.get("agentMaxCounter", 1)), data["actualPaths"]
        if ticks < 1:
            raise ValueError
        if sum(int(times) for text in paths for _, times in _RUN.findall(text)) > _MOST_ACTIONS:
            raise PlanError(f"{path}: robots take more than {_MOST_ACTIONS:,} actions")
        actions = [_actions(text) for text in paths]
        starts = [(int(row), int(column), "ESWN".index(towards)) for row, column, towards in data["start"]]
        cells = [np.array(list(_driven(*one, ticks)), np.int64) for one in zip(starts, actions, strict=True)]
        tasks: list[list[int]] = [[] for _ in cells]
        for step, robot in _finishes(data.get("events", [])):
            tasks[robot].append(int(step))
    except PlanError:  # which is a ValueError
        raise
    except (KeyError, ValueError, TypeError, IndexError, AttributeError, OverflowError):
        raise PlanError(
            f"{path} is JSON without `start` and `actualPaths` as the League of Robot Runners' output has them"
        ) from None
    if len(set(map(len, cells))) != 1:
        raise PlanError(f"{path}: `actualPaths` must have as many actions for each robot")
    plan = GridPlan(np.array(cells).transpose(1, 0, 2), tuple(map(tuple, tasks)), ticks)
    return plan if any(tasks) else finished(plan.cells)._replace(ticks=ticks)


def _actions(text: str) -> str:
    """Return a letter for each action, of actions divided by commas or of segments with runs of equal actions."""
    if not text.startswith("["):
        return text.replace(",", "")
    if not _SEGMENTS.fullmatch(text):
        raise ValueError
    return "".join(action * int(times) for action, times in _RUN.findall(text))


def _finishes(events: Sequence[Any]) -> Iterator[tuple[int, int]]:
    """Yield (step, robot) of finished tasks: events of 2024, [step, robot, task, part], or of 2023, a list a robot."""
    for robot, event in enumerate(events):
        if all(isinstance(one, int) for one in event) and event:
            yield event[0], event[1]
        else:
            yield from ((step, robot) for _, step, told in event if told == "finished")


def _driven(start: tuple[int, int, int], actions: str, ticks: int) -> Iterator[Cell]:
    """Yield the cells of a robot that turns on the spot, at first and after each action. ticks: of a move or turn."""
    row, column, facing = start
    done = 0
    yield row, column
    for action in actions:
        turned, done = _TURNED[action], done + (action not in "WT")
        if done == ticks:
            done, facing = 0, (facing + turned) % 4
            if action == "F":
                row, column = row + _FACING["ESWN"[facing]][0], column + _FACING["ESWN"[facing]][1]
        yield row, column
