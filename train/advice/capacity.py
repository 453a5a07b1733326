"""How many robots a floor bears: growing numbers until they jam, then halving the gap; from rows alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from train.reporting.report import MEASURES
from train.reporting.rows import Interval, Row

FIRST = 8  # robots tried first
STUCK = 0.05  # share of robots stuck at the end from which a floor counts as jammed
FELL = 0.9  # of the throughput with fewer robots, below which it counts as jammed as well
CLOSE = 0.125  # of the number that a floor bears: as near to the number that jams as it is brought
_SHOWN = ("late_goals_per_robot_hour", "stuck", "waiting_share")


class Load(NamedTuple):
    """What a floor does with a number of robots."""

    robots: int
    episodes: int
    goals: Interval  # per hour, all robots together, in the second half of the episodes
    each: Interval  # per robot and hour, the same
    stuck: Interval  # share at the end
    waiting: Interval  # share of time
    jammed: bool


def loads(rows: Mapping[int, Sequence[Row]]) -> list[Load]:
    """Return what was measured for each number of robots, fewest first.

    A floor is jammed with so many robots where STUCK of them are stuck, or all together reach less than FELL of the
    most that fewer robots reached.
    """
    found: list[Load] = []
    for robots in sorted(rows):
        own = rows[robots]
        each, stuck, waiting = (MEASURES[name].interval(own) for name in _SHOWN)
        goals = each.times(robots)
        best = max((load.goals.mean for load in found), default=0.0)
        jammed = stuck.mean >= STUCK or goals.mean < FELL * best
        found.append(Load(robots, len(own), goals, each, stuck, waiting, jammed))
    return found


def bears(found: Sequence[Load]) -> int:
    """Return the most robots that were tried of those below the fewest that jam; 0 if the fewest do."""
    most = 0
    for load in found:
        if load.jammed:
            break
        most = load.robots
    return most


def next_count(found: Sequence[Load], most: int) -> int | None:
    """Return the number of robots to try next, at most `most`; None where it is known closely enough.

    Twice as many while there is no jam, then the middle between the most without and the fewest with one. found: as
    `loads` gives them.
    """
    good = bears(found)
    jams = next((load.robots for load in found if load.jammed), None)
    if jams is None:
        following = 2 * good if good >= FIRST else FIRST
        return min(following, most) if good < most else None
    if jams - good <= max(1, CLOSE * good):
        return None
    return (good + jams) // 2
