"""The exact check of a solution, ours or others', at every instant, and its figures."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

from train.clmapf.contact import ALONE, NEVER, Shape, follow
from train.clmapf.instance import BODY, DISC_RADIUS, Instance, States
from train.clmapf.motions import BEGIN, END, LENGTH, Fault, Motions, body_beyond, motions_of

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
    shape = Shape(
        BODY.half_length, BODY.half_width, 0.5 * (BODY.ahead - BODY.behind), max(BODY.ahead, BODY.behind),
        DISC_RADIUS, slack,
    )  # fmt: skip
    bodies, gap = _bodies(instance, motions, shape)
    discs, disc_gap = _discs(instance, motions, shape)
    ends = list(_arrivals(motions))
    driven = float(abs(motions.arcs[:, LENGTH]).sum())
    faults = [*found, *bodies, *discs]
    return SolutionCheck(
        faults, max(ends), sum(ends), driven, gap, disc_gap, body_beyond(motions, instance), slack, unit
    )  # fmt: skip


def _arrivals(motions: Motions) -> Iterator[float]:
    """Yield when each robot has arrived [s]."""
    for begin, end in itertools.pairwise(motions.first.tolist()):
        driving = [arc for arc in motions.arcs[begin:end].tolist() if abs(arc[LENGTH]) > _LEAST_SLACK]
        yield max(0.0, driving[-1][END]) if driving else 0.0


def _bodies(instance: Instance, motions: Motions, shape: Shape) -> tuple[list[Fault], float]:
    """Return which robots overlap, and the least gap of two."""
    faults, least, first, arcs = [], _HORIZON, motions.first.tolist(), motions.arcs
    for i, j in itertools.combinations(range(len(instance.names)), 2):
        end = max(arcs[first[i + 1] - 1, BEGIN], arcs[first[j + 1] - 1, BEGIN])
        pair = (first[i], first[i + 1] - 1), (first[j], first[j + 1] - 1)
        since, depth, least = follow(arcs, *pair, (0.0, 0.0), end, least, shape)
        if since != NEVER:
            faults.append(Fault("overlaps", instance.names[i], instance.names[j], since, depth))
    return faults, least


def _discs(instance: Instance, motions: Motions, shape: Shape) -> tuple[list[Fault], float]:
    """Return which robots overlap discs, and the least gap."""
    faults, least, first, arcs = [], _HORIZON, motions.first.tolist(), motions.arcs
    for i, name in enumerate(instance.names):
        own = first[i], first[i + 1] - 1
        for k, (x, y) in enumerate(instance.discs.tolist()):
            since, depth, least = follow(arcs, own, (ALONE, ALONE), (x, y), arcs[own[1], END], least, shape)
            if since != NEVER:
                faults.append(Fault("overlaps obstacle", name, str(k), since, depth))
    return faults, least
