"""What a look for a better route costs by the colony and by the search, and how much dearer the colony's ways are.

Robots drive by PF-ACO's routes; at each look the search looks as well, at the same prices and for the same saving, and
what both find is priced by a count of its own. Routes that robots look for on their way must save something, so that
most looks end where nothing can.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import make_policy, policy_config
from train.reporting.report import Table, number
from train.reporting.rows import Row
from warehouse_env.config import EnvConfig
from warehouse_env.kernel import kernel
from warehouse_env.planning.cost_to_go import UNIT
from warehouse_env.planning.graph_search import START, is_hairpin
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.traffic.live import Finder
from warehouse_env.simulation.traffic.prices import ReplanQuery, is_beyond, price_of, rest_from
from warehouse_env.simulation.traffic.route_occupancy import eighth

POLICY = "threaded_ppo"
FLOORS = ("paper46", "narrow", "aisles:seed=601", "aisles:seed=602")
ROBOTS = (32, 64)
WARM = 30  # [s] simulated before looks count
_NO_CELLS = np.empty((0, 2), np.int32)


@kernel
def way_cost(look: ReplanQuery, cells: NDArray[np.int32]) -> int:
    """Return what a way along cells int32[L, 2] costs as far as a robot looks, and from there the shortest way."""
    total, arrived = 0, START
    row, column = cells[0, 0], cells[0, 1]
    for k in range(1, len(cells)):
        if is_beyond(look, row, column):
            break
        i, j = cells[k, 0], cells[k, 1]
        move, columns = eighth(i - row, j - column), look.steps.shape[1]
        total += int(look.steps[row, column, move]) + price_of(look, row * columns + column, move, i * columns + j)
        total += look.hairpin if is_hairpin(arrived, move) else 0
        row, column, arrived = i, j, move
    return int(total + rest_from(look, row, column))


class Beside(Finder):
    """Ants that find a robot's routes, with a search beside them that is timed and held against them."""

    def __init__(self, shape: tuple[int, int]) -> None:
        super().__init__("pf_aco", shape)
        self.search = Finder("astar_turns", shape)
        self.looks: list[tuple[bool, float, float, int, int]] = []  # on its way; seconds; costs, 0 where none is found

    def find(
        self, look: ReplanQuery, cells: NDArray[np.int32], saving: int, runs_out: bool, seed: int
    ) -> NDArray[np.int32]:
        """Return what the ants find."""
        times, costs = [], []
        for find in (self.search.find, super().find):
            begin = time.thread_time()
            found = find(look, cells, saving, runs_out, seed)
            times.append(time.thread_time() - begin)
            costs.append(0 if runs_out or not len(found) else int(way_cost(look, found)))
        if not runs_out:
            self.looks.append((saving >= 0, times[0], times[1], costs[0], costs[1]))
        return found


def looks(seconds: float, seed: int) -> Iterator[Row]:
    """Yield rows of looks on each floor with each number of robots, `seconds` of clock each: at a start, on the way."""
    for layout in FLOORS:
        for robots in ROBOTS:
            beside = _drive(layout, robots, seconds, seed)
            for on_its_way in (False, True):
                own = [one for one in beside.looks if one[0] == on_its_way]
                if own:
                    yield {"layout": layout, "robots": robots, "on_its_way": on_its_way, **_summary(own)}


def _drive(layout: str, robots: int, seconds: float, seed: int) -> Beside:
    config = policy_config(POLICY, EnvConfig(layout=layout, num_agents=robots, planner="pf_aco"))
    simulator, policy, rng = Simulator(config), make_policy(POLICY, config), np.random.default_rng(seed)
    live = simulator.dispatcher.live
    assert live is not None
    live.finder = beside = Beside(simulator.grid.shape)
    observation, begin = simulator.reset(seed), None
    while begin is None or time.perf_counter() - begin < seconds or not beside.looks:
        observation = simulator.step(policy.act(observation, rng))
        if begin is None and simulator.seconds(0) >= WARM:
            beside.looks, begin = [], time.perf_counter()
    return beside


def _summary(own: Sequence[tuple[bool, float, float, int, int]]) -> dict[str, Any]:
    """Return the numbers of some looks; the gap over those in which both found a way."""
    both = [(one[3], one[4]) for one in own if one[3] and one[4]]
    return {
        "looks": len(own),
        "search_us": 1e6 * statistics.fmean(one[1] for one in own),
        "ants_us": 1e6 * statistics.fmean(one[2] for one in own),
        "ants_99": 1e6 * float(np.percentile([one[2] for one in own], 99)),
        "search_found": sum(one[3] > 0 for one in own),
        "ants_found": sum(one[4] > 0 for one in own),
        "gap": statistics.fmean((ants - best) / UNIT for best, ants in both) if both else 0.0,
        "gap_share": sum(ants - best for best, ants in both) / sum(best for best, _ in both) if both else 0.0,
        "cheapest": statistics.fmean(ants <= best for best, ants in both) if both else 0.0,
    }


def looks_table(rows: Sequence[Row]) -> Table:
    """Return the table of `looks`' rows."""
    header = (
        "layout", "robots", "look", "looks", "search us", "ants us", "ratio", "99% us", "found", "of",
        "dearer by cells", "in %", "cheapest %",
    )  # fmt: skip
    cells = tuple(
        (
            row["layout"], str(row["robots"]), "on the way" if row["on_its_way"] else "at a start", str(row["looks"]),
            number(row["search_us"], 3), number(row["ants_us"], 3), number(row["ants_us"] / row["search_us"], 2),
            number(row["ants_99"], 3), str(row["ants_found"]), str(row["search_found"]), number(row["gap"], 2),
            number(100 * row["gap_share"], 2), f"{100 * row['cheapest']:.0f}",
        )
        for row in rows
    )  # fmt: skip
    note = (
        "The same looks by the search, which finds a cheapest way, and by the ants, whose ways are driven: mean times, "
        "the ants' 99th percentile; ways found by the ants and by the search; how much more the ants' cost where both "
        "found one."
    )
    return Table("A look for a better route", header, cells, note)
