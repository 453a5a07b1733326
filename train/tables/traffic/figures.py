"""From the traffic study's rows to tables, and plain answers to what a colony adds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from train.reporting.report import Table, grouped, number, with_interval
from train.reporting.rows import Interval, Row, is_told, mean_interval, paired, select
from train.tables.traffic.driving import DRIVEN_PRICE, POLICY
from train.tables.traffic.routes import PRICE

Value = Callable[[Row], float | None]
SAMPLE = ("map", "number", "case")  # what makes two rows a pair

ROUTES_NOTE = (
    "Conflicts a robot and task, each counted once for its pair: what a drive meets while all others repeat theirs at "
    "random times (unit speed; a robot keeps a cell for one unit). Crossings: cells shared, entered within that unit. "
    "Opposing: stretches shared in opposite directions. Paid: length over the sum of shortest paths. Against: paired "
    "difference of all conflicts from those of astar alone. Cost a cell or a move: two rounds of planning each robot "
    f"around all others, avoiding a conflict worth {PRICE:g} cells. Means over draws [95% interval by Student's t]. "
    "ms: a robot, all rounds and choices included."
)
ALTERNATIVES_NOTE = (
    "Up to 8 routes a task, at most a tenth longer than the best (k shortest paths: whatever comes first). Difference: "
    "share of the cells of two routes together that only one visits, mean over all pairs. Longer: mean over the routes."
)
REPLANNING_NOTE = (
    "Something is put on the best path and the task planned again: cold, or warm from the pheromone left behind. "
    "First: gap after the first iteration. Settled: when the last improvement came. Gaps are over the new optimum."
)
DRIVING_NOTE = (
    f"Driven by {POLICY}, episodes of 600 s, the same seeds for all. With cost: a map of the traffic to be expected, "
    f"made once for the floor and the number of robots, a conflict worth {DRIVEN_PRICE:g} cells. Against: paired "
    "difference from astar_turns."
)


def conflicts_of(row: Row) -> float:
    """All expected conflicts of a robot and task."""
    return float(row["crossings"] + row["opposing"])


def _field(name: str) -> Value:
    return lambda row: row.get(name)


def _means(group: Sequence[Row], **factors: float) -> list[str]:
    """Return the means of fields with their intervals, each times its factor."""
    return [with_interval(mean_interval(row[name] for row in group), factor) for name, factor in factors.items()]


def _ms(group: Sequence[Row]) -> str:
    return number(mean_interval(row["ms"] for row in group).mean)


def routes_table(name: str, rows: Sequence[Row]) -> Table:
    """Return the conflicts of every system's routes on a map."""
    lines = []
    own = [row for row in rows if row["part"] == "routes" and row["map"] == name]
    own = [row for row in own if row["price"] in (0.0, PRICE)]
    for (robots, system), group in grouped(own, ("robots", "system")).items():
        against = paired(group, select(own, robots=robots, system="astar"), conflicts_of, SAMPLE)
        texts = [*_means(group, crossings=1, opposing=1, paid=100), with_interval(against), _ms(group)]
        lines.append((str(robots), str(system), str(len(group)), *texts))
    lines.sort(key=lambda line: int(line[0]))
    header = ("robots", "system", "n", "crossings", "opposing", "paid %", "against astar", "ms")
    return Table(f"Routes on {name}", header, tuple(lines), ROUTES_NOTE)


def alternatives_table(rows: Sequence[Row]) -> Table:
    """Return how many and how different routes each source of alternatives gives."""
    own = [row for row in rows if row["part"] == "routes" and "difference" in row and row["robots"] == 16]
    lines = []
    for (name, system), group in grouped(own, ("map", "system")).items():
        texts = [*_means(group, alternatives=1, difference=1, alternatives_paid=100), _ms(group)]
        lines.append((str(name), str(system), str(len(group)), *texts))
    header = ("map", "system", "n", "routes", "difference", "longer %", "ms")
    return Table("Several routes for one task", header, tuple(lines), ALTERNATIVES_NOTE)


def replanning_table(rows: Sequence[Row]) -> Table:
    """Return how fast and how well each system plans again on a changed floor."""
    own = [row for row in rows if row["part"] == "replanning"]
    lines = []
    for (case, system), group in grouped(own, ("case", "system")).items():
        optimal = with_interval(mean_interval(float(row["optimal"]) for row in group).cut(1.0), 100)
        texts = [
            *_means(group, first_gap=100, gap=100),
            optimal,
            *_means(group, settled_at=1, settled_ms=1),
            _ms(group),
        ]
        lines.append((str(case), str(system), str(len(group)), *texts))
    header = ("case", "system", "n", "first %", "gap %", "optimal %", "settled at", "settled ms", "ms in all")
    lines.sort(key=lambda line: line[0])
    return Table("Planning again after a change", header, tuple(lines), REPLANNING_NOTE)


def driving_table(rows: Sequence[Row]) -> Table:
    """Return what the simulator makes of the routes."""
    own = [row for row in rows if row["part"] == "driving"]
    lines = []
    for (name, robots, system), group in grouped(own, ("map", "robots", "system")).items():
        base = select(own, map=name, robots=robots, system="astar_turns")
        texts = []
        for measure, factor in (("collisions_per_km", 1), ("goals_per_robot_hour", 1), ("stuck", 100)):
            texts += _means(group, **{measure: factor})
            texts.append(with_interval(paired(group, base, _field(measure), SAMPLE), factor))
        lines.append((str(name), str(robots), str(system), str(len(group)), *texts))
    header = (
        "map", "robots", "routes", "n", "collisions/km", "against", "goals/robot-h", "against", "stuck %", "against",
    )  # fmt: skip
    return Table("Driven", header, tuple(lines), DRIVING_NOTE)


class Question(NamedTuple):
    """What is asked: is `ours` better than `other` in a value, where less is better unless `more`."""

    text: str
    part: str
    ours: str
    other: str
    value: Value
    unit: str
    robots: int | None = None
    more: bool = False


_MOVE, _CHOICE = "pf_aco, cost a move", "pf_aco routes, choice of 8"
_GOALS, _HITS = "goals_per_robot_hour", "collisions_per_km"


def _about_routes(text: str, ours: str, other: str, robots: int = 32) -> Question:
    return Question(text, "routes", ours, other, conflicts_of, "conflicts", robots)


def _about_replanning(text: str, ours: str, other: str, field: str = "settled_ms", unit: str = "ms") -> Question:
    return Question(text, "replanning", ours, other, _field(field), unit)


QUESTIONS = (
    _about_routes("Does a cost a move keep the colony's routes apart?", _MOVE, "pf_aco"),
    _about_routes("Better than A* with the same cost map?", _MOVE, "astar, cost a move"),
    _about_routes("Is a cost a move better than a cost a cell?", "astar, cost a move", "astar, cost a cell"),
    _about_routes("Does a choice of the colony's routes keep them apart?", _CHOICE, "pf_aco"),
    _about_routes("Better than a choice from A* with penalties?", _CHOICE, "astar with penalties, choice of 8"),
    _about_routes("Better than a choice of the k shortest paths?", _CHOICE, "k shortest paths, choice of 8", 16),
    _about_routes("Better than the cost map?", _CHOICE, _MOVE),
    _about_replanning("Is a warm colony sooner done than a cold one?", "pf_aco, warm", "pf_aco, cold"),
    _about_replanning("And without local search?", "pf_aco (paper), warm", "pf_aco (paper), cold"),
    _about_replanning("Is its path better?", "pf_aco, warm", "pf_aco, cold", "gap", "of length"),
    _about_replanning("Is it sooner done than A*?", "pf_aco, warm", "astar"),
    Question("Driven: more goals with the cost map?", "driving", _MOVE, "pf_aco", _field(_GOALS), _GOALS, 32, True),
    Question("Driven: fewer collisions?", "driving", _MOVE, "pf_aco", _field(_HITS), _HITS, 32),
    Question("Driven: more goals than by A*?", "driving", "pf_aco", "astar_turns", _field(_GOALS), _GOALS, 32, True),
)


def answers(rows: Sequence[Row], maps: Sequence[str]) -> Table:
    """Return every question with its answer on each map: yes or no where the paired 95% interval is clear of zero."""
    lines = []
    for asked in QUESTIONS:
        cells = []
        for name in maps:
            own = select(rows, part=asked.part, map=name)
            if asked.robots is not None:
                own = [row for row in own if row["robots"] == asked.robots]
            own = [row for row in own if row.get("price", 0.0) in (0.0, PRICE)]
            found = paired(select(own, system=asked.ours), select(own, system=asked.other), asked.value, SAMPLE)
            cells.append(_answer(found, asked))
        lines.append((asked.text, f"{asked.ours} against {asked.other}", *cells))
    note = "Paired differences with their 95% interval; no difference told: the interval holds zero."
    return Table("What a colony adds", ("question", "compared", *maps), tuple(lines), note)


def _answer(found: Interval, asked: Question) -> str:
    if not found.samples:
        return "not run"
    text = f"{with_interval(found)} {asked.unit}"
    if not is_told(found):
        return f"no difference told: {text}"
    return f"{'yes' if (found.mean > 0) == asked.more else 'no'}: {text}"
