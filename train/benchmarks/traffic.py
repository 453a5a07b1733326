"""What right of way costs: a decision of worlds with more and more of the traffic options, in turns within one run."""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Iterator, Sequence

import numpy as np

from train.reporting.report import Table, number
from train.reporting.rows import Row, select
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.traffic_spec import TRAFFIC, TrafficSpec

LAYOUT, PLANNER = "paper46", "astar_turns"
ROBOTS = (16, 64)
WARM = 120  # [s] simulated before the clock starts: by then robots are in each other's way
CHUNKS, LEAST = 9, 25  # the time of a row is the median over so many chunks of so many decisions at least
OPTIONS = {
    "none": TrafficSpec(),
    "field": TrafficSpec(shield=True),
    "right of way": TrafficSpec(shield=True, right_of_way=True),
    "live routes as well": TRAFFIC["rules"],
}


def traffic(seconds: float, seed: int) -> Iterator[Row]:
    """Yield a row for each number of robots and each set of options; all robots cruise. `seconds` of clock a row."""
    for robots in ROBOTS:
        worlds = {name: _world(robots, options, seed) for name, options in OPTIONS.items()}
        once = sum(_time(world, LEAST) for world in worlds.values())
        decisions = max(LEAST, round(seconds * LEAST * len(worlds) / (CHUNKS * once)))
        chunks = [{name: _time(world, decisions) for name, world in worlds.items()} for _ in range(CHUNKS)]
        for name in worlds:
            ms = [1000 * chunk[name] / decisions for chunk in chunks]
            over = [chunk[name] / chunk["none"] for chunk in chunks]
            yield {
                "layout": LAYOUT, "robots": robots, "options": name, "ms": statistics.median(ms), "low": min(ms),
                "high": max(ms), "over_none": statistics.median(over),
            }  # fmt: skip


def _world(robots: int, options: TrafficSpec, seed: int) -> Simulator:
    config = EnvConfig(layout=LAYOUT, num_agents=robots, planner=PLANNER, action_repeat=2, traffic=options)
    simulator = Simulator(config.replace(max_steps=sys.maxsize))
    simulator.reset(seed)
    _time(simulator, round(WARM / (config.action_repeat * config.time_step)))
    return simulator


def _time(simulator: Simulator, decisions: int) -> float:
    """Return the seconds that so many decisions take."""
    cruise = np.full((1, simulator.num_agents), simulator.cruise_action)
    begin = time.perf_counter()
    for _ in range(decisions):
        simulator.step(cruise)
    return time.perf_counter() - begin


def traffic_table(rows: Sequence[Row]) -> Table:
    """Return the table of `traffic`'s rows."""
    header = ("layout", "robots", "options", "ms a decision", "spread", "over none")
    cells = tuple(
        (
            row["layout"], str(row["robots"]), row["options"], number(row["ms"], 3),
            f"{number(row['low'], 3)} to {number(row['high'], 3)}", number(row["over_none"], 2),
        )
        for robots in dict.fromkeys(row["robots"] for row in rows)
        for row in select(rows, robots=robots)
    )  # fmt: skip
    note = f"A decision: 0.2 s of one world, on one core, all robots at cruising speed, after {WARM} s of it."
    return Table("What right of way costs", header, cells, note)
