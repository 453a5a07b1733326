"""Jobs that solve an instance, or check a solution of it exactly at every instant, and the tables of their rows."""

import itertools
import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from train.central.floor import floor_of
from train.central.together import Together, plan_together
from train.clmapf.contact import ALONE, NEVER, follow
from train.clmapf.instance import (
    BODY,
    DISC_RADIUS,
    Instance,
    States,
    gaps,
    read_instance,
    read_solution,
    why_impossible,
    write_solution,
)
from train.clmapf.motions import END, LENGTH, Fault, Motions, body_beyond, motions_of
from train.evaluation.jobs import Job, Result, Tick
from train.reporting.report import Table, grouped, number, with_interval
from train.reporting.rows import Row, mean_interval, wilson_interval
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


def instances_in(folder: Path) -> list[str]:
    """Return the names of all instances below a folder, in order."""
    if not folder.is_dir():
        raise MapError(f"{folder} is no folder; name one that holds the benchmark's instances, *.yaml")
    names = sorted(str(path.relative_to(folder)) for path in folder.rglob("*.[yY][aA][mM][lL]"))
    if not names:
        raise MapError(f"{folder} holds no instances, *.yaml")
    return names


_HEADER = (
    "floor", "obstacles", "robots", "instances", "impossible", "solved of the others", "makespan", "flowtime",
    "seconds", "most",
)  # fmt: skip
NOTE = (
    "solved: by the exact check, of the instances that are not impossible as stated [95% interval by Wilson's score]. "
    "makespan, flowtime: means over the solved ones, at unit speed. seconds: of one core."
)


def cells_table(rows: Sequence[Row]) -> Table:
    """Return one line for each cell of the benchmark."""
    ordered = sorted(rows, key=lambda row: (row["size"], row["obstacle"], row["agents"]))
    lines = [_line(group) for group in grouped(ordered, ("size", "obstacle", "agents")).values()]
    return Table("CL-MAPF, as stated", _HEADER, tuple(lines), NOTE)


def _line(group: Sequence[Row]) -> tuple[str, ...]:
    first = group[0]
    possible = [row for row in group if not row["impossible"]]
    solved = [row for row in possible if row["solved"]]
    share = with_interval(wilson_interval(len(solved), len(possible)), 100.0) + "%" if possible else "-"
    seconds = [row["seconds"] for row in possible if "seconds" in row]
    side, obstacles = f"{first['size']:g}", "yes" if first["obstacle"] else "none"
    return (
        f"{side} x {side}", obstacles, str(first["agents"]), str(len(group)), str(len(group) - len(possible)),
        f"{len(solved)}: {share}", _mean(solved, "makespan"), _mean(solved, "flowtime"),
        number(sum(seconds) / len(seconds), 2) if seconds else "-", number(max(seconds), 2) if seconds else "-",
    )  # fmt: skip


def _mean(rows: Iterable[Row], name: str) -> str:
    values = [row[name] for row in rows]
    return number(mean_interval(values).mean) if values else "-"


def impossible_lines(rows: Iterable[Row]) -> list[str]:
    """Return a sentence for each instance that is impossible as stated."""
    return [f"{row['instance']}: {row['impossible'][0]}" for row in rows if row["impossible"]]


def unsolved_lines(rows: Iterable[Row]) -> list[str]:
    """Return a sentence for each possible instance that is not solved."""
    return [f"{row['instance']}: {_why(row)}" for row in rows if not (row["solved"] or row["impossible"])]


def _why(row: Row) -> str:
    if row.get("faults"):
        more = f" (and {row['fault_count'] - 1} more)" if row["fault_count"] > 1 else ""
        return f"{row['faults'][0]}{more}"
    if row.get("stranded"):
        return f"no route for {', '.join(row['stranded'])} even alone"
    return f"{row['meeting']} pairs still meet" if "meeting" in row else "no solution"


_LEAST_SLACK = 1e-6
_HORIZON = 1.0  # larger gaps are not measured


class SolutionCheck(NamedTuple):
    """What a check found."""

    faults: list[Fault]
    makespan: float  # [s] until the last robot has arrived
    flowtime: float  # [s] of all robots
    driven: float  # length of all robots' routes
    least_gap: float  # between two bodies, at most _HORIZON
    least_disc_gap: float  # between a body and a disc, at most _HORIZON
    body_beyond_border: float  # how far a body reaches beyond the border
    slack: float  # overlaps up to this count as rounding; all above twice this are found
    unit_of_t: float  # [s]


def figures(checked: SolutionCheck) -> Row:
    """Return a row about a solution."""
    return {
        **checked._asdict(), "solved": not checked.faults, "fault_count": len(checked.faults),
        "faults": [str(fault) for fault in checked.faults[:_FAULTS]],
    }  # fmt: skip


def check(instance: Instance, schedule: dict[str, States], unit: float = 1.0) -> SolutionCheck:
    """Check a solution: its robots, ends, arcs, curvature, speed, border, bodies and discs.

    unit: seconds of a unit of t.
    """
    faults = [Fault("has no states", name, "", 0.0, 0.0) for name in instance.names if name not in schedule]
    faults += [Fault("is no robot", name, "", 0.0, 0.0) for name in schedule if name not in instance.names]
    if faults:
        return SolutionCheck(faults, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, 0.0, unit)
    motions, found = motions_of(instance, schedule, unit)
    slack = max(_LEAST_SLACK, 2.0 * motions.miss)
    overlaps, gap, disc_gap = _overlaps(instance, motions, slack)
    ends = list(_arrivals(motions))
    driven = float(abs(motions.arcs[:, LENGTH]).sum())
    faults, beyond = [*found, *overlaps], body_beyond(motions, instance)
    return SolutionCheck(faults, max(ends), sum(ends), driven, gap, disc_gap, beyond, slack, unit)


def _arrivals(motions: Motions) -> Iterator[float]:
    """Yield when each robot has arrived [s]."""
    for begin, end in itertools.pairwise(motions.first.tolist()):
        driving = [arc for arc in motions.arcs[begin:end].tolist() if abs(arc[LENGTH]) > _LEAST_SLACK]
        yield max(0.0, driving[-1][END]) if driving else 0.0


def _overlaps(instance: Instance, motions: Motions, slack: float) -> tuple[list[Fault], float, float]:
    """Return which robots overlap each other or discs, the least gap of two robots, and the least one to a disc."""
    floor = floor_of(instance.width, instance.height, instance.discs, DISC_RADIUS, BODY, 0.0)
    arcs = [(begin, end - 1) for begin, end in itertools.pairwise(motions.first.tolist())]
    robots, least = list(zip(instance.names, arcs, strict=True)), {"overlaps": _HORIZON, "overlaps obstacle": _HORIZON}
    discs = [(str(k), (ALONE, k)) for k in range(len(instance.discs))]
    pairs = [("overlaps", *pair) for pair in itertools.combinations(robots, 2)]
    pairs += [("overlaps obstacle", *pair) for pair in itertools.product(robots, discs)]
    faults = []
    for kind, (name, own), (other, its) in pairs:
        since, depth, least[kind] = follow(motions.arcs, own, its, least[kind], floor, slack)
        if since != NEVER:
            faults.append(Fault(kind, name, other, since, depth))
    return faults, least["overlaps"], least["overlaps obstacle"]
