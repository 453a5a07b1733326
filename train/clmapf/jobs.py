"""Jobs that solve an instance, or check a solution of it, and keep a row."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from train.central.floor import floor_of
from train.central.together import Together, plan_together
from train.clmapf.check import SolutionCheck, check
from train.clmapf.instance import BODY, DISC_RADIUS, Instance, gaps, read_instance, why_impossible
from train.clmapf.solution import read_solution, write_solution
from train.evaluation.jobs import Job, Result, Tick
from train.reporting.rows import Row
from warehouse_env import __version__
from warehouse_env.errors import MapError

_FAULTS = 20  # in a row
_MARGIN = 0.01  # between bodies and to discs, less if the given poses are nearer


@dataclass(frozen=True)
class InstanceJob(Job):
    """Solve an instance and check the solution as it is written, or only check a solution."""

    folder: Path
    name: str  # of the file in the folder
    solutions: Path  # a folder
    seed: int | None = None  # of the planner; None: only check
    unit: float = 1.0  # seconds of a unit of t

    titled = "{name}"

    def run(self, tick: Tick) -> Result:
        """Return the row."""
        instance, path = read_instance(self.folder / self.name, self.name), self.solutions / self.name
        row = row_of(instance)
        if self.seed is not None:
            row |= {"seed": self.seed, "version": __version__}
            if row["impossible"]:
                return Result([row])
            found, seconds = solve(instance, self.seed)
            row |= {"seconds": seconds, "nodes": found.nodes, "meeting": found.meeting}
            row |= {"stranded": [instance.names[i] for i in found.stranded]}
            if found.stranded or found.meeting:
                return Result([row])
            write_solution(path, instance.names, found.routes, seconds)
            row["flowtime_alone"] = float(found.alone.sum())
        if path.is_file():
            row |= figures(check(instance, read_solution(path), self.unit))
        return Result([row])


def solve(instance: Instance, seed: int) -> tuple[Together, float]:
    """Plan routes for all robots; return them and the processor time [s], without compiling."""
    _warm_up()
    begun = time.process_time()
    margin = min([_MARGIN, *(0.5 * gap for gap, _ in gaps(instance))])
    floor = floor_of(instance.width, instance.height, instance.discs, DISC_RADIUS, BODY, margin)
    starts, goals = ([tuple(pose) for pose in poses.tolist()] for poses in (instance.starts, instance.goals))
    found = plan_together(starts, goals, floor, seed)
    return found, time.process_time() - begun


@lru_cache(maxsize=1)
def _warm_up() -> None:
    """Load or compile the kernels, with three robots of which two meet."""
    starts = [(5.0, 10.0, 0.0), (25.0, 10.0, np.pi), (5.0, 5.0, 0.0)]
    goals = [(25.0, 10.0, 0.0), (5.0, 10.0, np.pi), (8.0, 5.0, 0.5)]
    plan_together(starts, goals, floor_of(30.0, 20.0, np.array([[15.0, 2.0]]), DISC_RADIUS, BODY, _MARGIN), 0)


def row_of(instance: Instance) -> Row:
    """Return a row about an instance."""
    return {
        "instance": instance.name, "size": instance.width, "agents": len(instance.names),
        "obstacle": len(instance.discs) > 0, "obstacles": len(instance.discs),
        "impossible": list(why_impossible(instance)), "solved": False,
    }  # fmt: skip


def figures(checked: SolutionCheck) -> Row:
    """Return a row about a solution."""
    return {
        **checked._asdict(), "solved": not checked.faults, "fault_count": len(checked.faults),
        "faults": [str(fault) for fault in checked.faults[:_FAULTS]],
    }  # fmt: skip


def instances_in(folder: Path) -> list[str]:
    """Return the names of all instances below a folder, in order."""
    if not folder.is_dir():
        raise MapError(f"{folder} is no folder; name one that holds the benchmark's instances, *.yaml")
    names = sorted(str(path.relative_to(folder)) for path in folder.rglob("*.[yY][aA][mM][lL]"))
    if not names:
        raise MapError(f"{folder} holds no instances, *.yaml")
    return names
