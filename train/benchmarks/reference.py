"""Measure our step beside a reference of fixed work in the same process, in turns, by processor time.

Every chunk is a fixed number of steps from the same start, so slow and fast machines simulate the same. A ratio is that
of neighbouring chunks, so it does not depend on a machine whose speed varies.
"""

from __future__ import annotations

import copy
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents import make_policy, policy_config
from train.benchmarks.fixed_work import InC, InNumba, Step, compiler, floor
from train.reporting.report import Table, number
from train.reporting.rows import Row
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.simulator import Simulator

IN_C, KERNEL = "C", "the kernel"  # names of the references
SEEDS = 16  # large batches repeat these starts
POOL = 16  # commands, drawn before the clock starts and then cycled
POLICY = "greedy"  # its decisions are measured, with shield, right of way and live routes
DECISIONS = {32: 60, 128: 15, 512: 2}  # robots of a single world -> decisions in a chunk
DENSITY = 32 / 46**2  # [robots a cell] of these worlds
WARM = 10  # decisions before the clock starts
BESIDE = (64, 16)  # the reference's worlds x robots beside single worlds


class Size(NamedTuple):
    """Worlds x robots, the steps in a chunk of each kind, and the steps before the clock starts."""

    worlds: int
    robots: int
    reference: int
    same_work: int
    others: int
    warm: int


SIZES = (Size(64, 16, 60, 100, 30, 20), Size(1024, 32, 2, 3, 1, 5))


class Timed(NamedTuple):
    """A function that steps `rows` robots, called `steps` times in a chunk."""

    call: Step
    rows: int
    steps: int

    def warmed(self, steps: int) -> Timed:
        """Return this after some steps; the timed steps continue where these end."""
        for k in range(steps):
            self.call(k)
        return self._replace(call=lambda k, call=self.call: call(k + steps))  # type: ignore[misc]


def reference(chunks: int, seed: int, each: bool = False) -> Iterator[Row]:
    """Yield a row for each configuration and size: the speed of a step over that of the reference, with quartiles.

    The reference is C where there is a compiler, else a kernel; `each`: both, in separate rows.
    """
    with tempfile.TemporaryDirectory() as folder:
        for size in SIZES:
            given = _references(size.worlds, size.robots, size.reference, Path(folder), each)
            for name, timed in _configurations(size, seed):
                named = {"run": name, "envs": size.worlds, "agents": size.robots}
                yield from _rows(named, timed, given, chunks)
        beside = _references(*BESIDE, SIZES[0].reference, Path(folder), each)
        for robots, decisions in DECISIONS.items():
            named = {"run": f"{POLICY}'s decision", "envs": 1, "agents": robots}
            yield from _rows(named, _decision(robots, decisions, seed), beside, chunks)


def _references(worlds: int, robots: int, steps: int, folder: Path, each: bool) -> dict[str, Timed]:
    made: dict[str, Callable[[], Step]] = {}
    if compiler() is not None:
        made[IN_C] = lambda: InC(worlds, robots, folder)
    if each or not made:
        made[KERNEL] = lambda: InNumba(worlds, robots)
    return {name: Timed(make(), worlds * robots, steps).warmed(3) for name, make in made.items()}


def _configurations(size: Size, seed: int) -> Iterator[tuple[str, Timed]]:
    """Yield the configurations by name, one at a time, since 1,024 worlds need memory."""
    rng = np.random.default_rng(seed)
    shape = (POOL, size.worlds, size.robots)
    raw = _simulator(size, seed, action_type="raw", substeps=1)
    yield "same work", _timed(raw, rng.uniform(-1, 1, (*shape, 2)).astype(np.float32), size.same_work, size.warm)
    random = _simulator(size, seed)
    full = copy.deepcopy(random)
    choices = rng.integers(0, len(random.config.speed_levels) * len(random.config.lateral_offsets), shape)
    yield "random commands", _timed(random, choices, size.others, size.warm)
    cruise = np.broadcast_to(full.cruise_action, shape)
    yield "full speed", _timed(full, cruise, size.others, size.warm)
    trained = _simulator(size, seed, sensor=SensorSpec(predictions=True), action_repeat=2)
    yield "training", _timed(trained, choices, size.others, size.warm)


def _simulator(size: Size, seed: int, **options: Any) -> Simulator:
    """Return worlds after a reset; with raw actions, on the floor of the fixed work."""
    config = EnvConfig(num_agents=size.robots, planner="astar", max_steps=sys.maxsize, **options)
    grid = GridMap(floor()[1:-1, 1:-1].astype(bool), name="fixed work") if config.action_type == "raw" else None
    simulator = Simulator(config, size.worlds, grid=grid)
    simulator.reset([seed + k % SEEDS for k in range(size.worlds)])
    return simulator


def _timed(simulator: Simulator, pool: NDArray[Any], steps: int, warm: int) -> Timed:
    rows = simulator.num_worlds * simulator.num_agents
    return Timed(lambda k: simulator.step(pool[k % POOL]), rows, steps).warmed(warm)


def _decision(robots: int, decisions: int, seed: int) -> Timed:
    """Return a single world of so many robots, at one density, with the policy that drives it."""
    side = round((robots / DENSITY) ** 0.5)
    base = EnvConfig(num_agents=robots, planner="astar_turns", max_steps=sys.maxsize)
    config = policy_config(POLICY, base)
    simulator = Simulator(config, grid=make_layout("blocks", rows=side, columns=side))
    policy, rng = make_policy(POLICY, config), np.random.default_rng(seed)
    simulator.reset(seed)
    return Timed(lambda _: simulator.step(policy.act(simulator.observation, rng)), robots, decisions).warmed(WARM)


def _rows(named: Row, ours: Timed, references: dict[str, Timed], chunks: int) -> Iterator[Row]:
    """Yield a row for each reference: its time over ours, which is our speed over its speed."""
    spent = in_turns([ours, *references.values()], chunks)
    for name, theirs in zip(references, spent[1:], strict=True):
        low, ratio, high = statistics.quantiles([b / a for a, b in zip(spent[0], theirs, strict=True)], n=4)
        yield {
            **named, "reference": name, "ratio": ratio, "low": low, "high": high, "chunks": chunks,
            "us_a_robot": statistics.median(spent[0]), "reference_us": statistics.median(theirs),
        }  # fmt: skip


def in_turns(timed: Sequence[Timed], chunks: int) -> list[list[float]]:
    """Return for each its processor time [us] of a robot's step in each chunk, measured in turns."""
    spent: list[list[float]] = [[] for _ in timed]
    for chunk in range(chunks):
        for one, times in zip(timed, spent, strict=True):
            begin = time.process_time()
            for k in range(chunk * one.steps, (chunk + 1) * one.steps):
                one.call(k)
            times.append(1e6 * (time.process_time() - begin) / (one.steps * one.rows))
    return spent


def reference_table(rows: Sequence[Row]) -> Table:
    """Return the table of `reference`'s rows: a line for each configuration and size, two columns a reference."""
    kinds = list(dict.fromkeys(row["reference"] for row in rows))
    columns = [name for kind in kinds for name in (f"over {kind}", "quartiles")]
    lines: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        lines.setdefault((row["run"], f"{row['envs']} x {row['agents']}"), {})[row["reference"]] = row
    cells = tuple(
        (*named, number(next(iter(over.values()))["us_a_robot"], 3), *_ratios(over, kinds))
        for named, over in lines.items()
    )
    last = rows[-1]
    note = (
        f"The speed of a step over that of fixed work for as many robots, in turns, on one core ({last['commit']}, "
        f"{last['date']}). A decision: 0.1 s of one world, beside the work of {BESIDE[0]} x {BESIDE[1]}."
    )
    header = ("what", "worlds x robots", "us a robot", *columns)
    return Table("The step beside fixed work", header, cells, note)


def _ratios(over: dict[str, Row], kinds: Sequence[str]) -> Iterator[str]:
    for kind in kinds:
        row = over.get(kind)
        yield number(row["ratio"], 3) if row else ""
        yield f"{number(row['low'], 3)} to {number(row['high'], 3)}" if row else ""
