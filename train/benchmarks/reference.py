"""Measure our step beside fixed work in C in the same process, in turns, and compare the ratios with the release's.

Every chunk is a fixed number of steps from the same start, so slow and fast machines simulate the same. A ratio is that
of neighbouring chunks by processor time, so it does not depend on a machine whose speed varies.
"""

import copy
import datetime
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents import make_policy, policy_config
from train.benchmarks.fixed_work import FixedWork, floor
from train.benchmarks.timing import Timed, in_turns
from train.reporting.report import Table, number
from train.reporting.rows import Row, read_rows, select
from warehouse_env import __version__
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.simulator import Simulator

SEEDS = 16  # large batches repeat these starts
POOL = 16  # commands, drawn before the clock starts and then cycled
POLICY = "greedy"  # its decisions are measured, with shield, right of way and live routes
DECISIONS = {32: 60, 128: 15, 512: 2}  # robots of a single world -> decisions in a chunk
DENSITY = 32 / 46**2  # [robots a cell] of these worlds
WARM = 10  # decisions before the clock starts
BESIDE = (64, 16)  # the reference's worlds x robots beside single worlds

ROOT = Path(__file__).parents[2]
RELEASE = Path(__file__).parent / "release.jsonl"
RENEW = "warehouse bench --only reference --json train/benchmarks/release.jsonl"
_LEFT = 2 / 3  # of a release's ratio: losing a third is more than machines and minutes differ by
_NAMES = ("run", "envs", "agents")


class Size(NamedTuple):
    """Worlds x robots, the steps in a chunk of each kind, and the steps before the clock starts."""

    worlds: int
    robots: int
    reference: int
    same_work: int
    others: int
    warm: int


SIZES = (Size(64, 16, 60, 100, 30, 20), Size(1024, 32, 2, 3, 1, 5))


def reference(chunks: int, seed: int) -> Iterator[Row]:
    """Yield a row for each configuration and size: the speed of a step over that of the reference, with quartiles."""
    with tempfile.TemporaryDirectory() as folder:

        def fixed(worlds: int, robots: int, steps: int) -> Timed:
            return Timed(FixedWork(worlds, robots, Path(folder)), worlds * robots, steps).warmed(3)

        for size in SIZES:
            theirs = fixed(size.worlds, size.robots, size.reference)
            for name, ours in _configurations(size, seed):
                yield {"run": name, "envs": size.worlds, "agents": size.robots, **_ratio(ours, theirs, chunks)}
        theirs = fixed(*BESIDE, SIZES[0].reference)
        for robots, decisions in DECISIONS.items():
            ours = _decision(robots, decisions, seed)
            yield {"run": f"{POLICY}'s decision", "envs": 1, "agents": robots, **_ratio(ours, theirs, chunks)}


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


def _ratio(ours: Timed, theirs: Timed, chunks: int) -> Row:
    """Return the reference's time over ours, which is our speed over its speed."""
    spent, other = in_turns([ours, theirs], chunks, time.process_time)
    low, ratio, high = statistics.quantiles([b / a for a, b in zip(spent, other, strict=True)], n=4)
    times = {"us_a_robot": statistics.median(spent), "reference_us": statistics.median(other)}
    return {"ratio": ratio, "low": low, "high": high, "chunks": chunks, **times}


def reference_table(rows: Sequence[Row]) -> Table:
    """Return the table of `reference`'s rows: a line for each configuration and size."""
    cells = tuple(
        (
            row["run"], f"{row['envs']} x {row['agents']}", number(row["us_a_robot"], 3), number(row["ratio"], 3),
            f"{number(row['low'], 3)} to {number(row['high'], 3)}",
        )
        for row in rows
    )  # fmt: skip
    note = (
        f"The speed of a step over that of fixed work for as many robots, in turns, on one core ({rows[-1]['commit']}, "
        f"{rows[-1]['date']}). A decision: 0.1 s of one world, beside the work of {BESIDE[0]} x {BESIDE[1]}."
    )
    header = ("what", "worlds x robots", "us a robot", "over C", "quartiles")
    return Table("The step beside fixed work", header, cells, note)


def judge(rows: Sequence[Row], path: Path = RELEASE) -> None:
    """Raise WarehouseError if a ratio of `reference` is a third below the release's, or the release has none."""
    ratios, written = select(rows, what="reference"), read_rows(path)
    pairs = [(row, select(written, **{name: row[name] for name in _NAMES})) for row in ratios]
    unknown = [_name(row) for row, known in pairs if not known]
    if unknown:
        raise WarehouseError(f"{path.name} has no ratio for {'; '.join(unknown)}: write all down with `{RENEW}`")
    fell = [
        f"{_name(row)} fell from {known['ratio']:.3g} of the speed of C to {row['ratio']:.3g}"
        for row, (known, *_) in pairs
        if row["ratio"] <= _LEFT * known["ratio"]
    ]
    if fell:
        raise WarehouseError(
            f"the step has lost a third of its speed or more since {written[0]['commit']} ({written[0]['date']}): "
            f"{'; '.join(fell)}. Measure again on a quiet machine; then find the commit that costs it and make it "
            f"cheaper, or, where it is worth its price, say so in the commit and write down new ratios with `{RENEW}`"
        )


def _name(row: Row) -> str:
    return f"{row['run']} at {row['envs']} x {row['agents']}"


def origin() -> Row:
    """Return the commit of the source ("-dirty" where files differ), or the version without git, and today's date."""
    command = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--exclude", "*"]
    commit = ""
    if (ROOT / ".git").exists() and shutil.which("git"):
        commit = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    return {"commit": commit or __version__, "date": datetime.date.today().isoformat()}
