"""The measurements of `warehouse bench`: each part yields rows. Heavy imports stay inside the parts."""

from __future__ import annotations

import math
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.reporting.rows import Row
from warehouse_env.config import EnvConfig
from warehouse_env.threads import MOST_THREADS, set_num_threads

_PLANNER = "astar"  # fast to plan; ants are measured by the part `plan`
_POLICY = "ppo"
_POOL = 32  # random actions, drawn before the clock starts and then cycled
_TRAINED = 5  # seconds of each training per second of the budget
_TURNS = 3  # chunks of the step and its reference per second of the budget
_CHUNKS = 9  # a rate is the median over these
_START_SEEDS = 16  # large batches repeat these starts: planning 30,000 routes is not what is measured
_SQUARE_PER_ROBOTS = {32: 46, 256: 130, 1024: 260}  # robots -> side of the floor [cells], at one density


@dataclass(frozen=True)
class Budget:
    """How long and how large to measure."""

    seconds: float  # for each row
    largest: int  # robots in a single world
    threads: tuple[int, ...]
    seed: int
    each_reference: bool = False  # compare the step with every reference, not the best one only


def _draws(space: Any, seed: int, *shape: int) -> NDArray[np.int64]:
    """Return int64[_POOL, *shape], random actions of a discrete space."""
    return np.random.default_rng(seed).integers(0, space.n, (_POOL, *shape))


class Rate(NamedTuple):
    """Calls a second: median, lowest and highest chunk."""

    median: float
    low: float
    high: float


def rate(call: Callable[[int], object], seconds: float) -> Rate:
    """Measure how often a second `call(k)` can be called, k counting up; the first calls only warm up."""
    begin, count = time.perf_counter(), 0
    while count < 3 or time.perf_counter() - begin < 0.1 * seconds:
        call(count)
        count += 1
        if count == 1:
            begin = time.perf_counter()  # the first call may compile
    per_chunk = max(1, math.ceil(count * 10 / _CHUNKS))
    rates = []
    for _ in range(_CHUNKS):
        begin = time.perf_counter()
        for k in range(count, count + per_chunk):
            call(k)
        rates.append(per_chunk / (time.perf_counter() - begin))
        count += per_chunk
    return Rate(statistics.median(rates), min(rates), max(rates))


def _speed(measured: Rate, envs: int, agents: int, threads: int) -> Row:
    """Return the common fields of a row from a rate of calls that step `envs` environments of `agents` robots each."""
    rows = envs * agents
    return {
        "envs": envs, "agents": agents, "threads": threads, "agent_steps_per_s": measured.median * rows,
        "low": measured.low * rows, "high": measured.high * rows, "env_steps_per_s": measured.median * envs,
    }  # fmt: skip


def simulator(budget: Budget) -> Iterator[Row]:
    """Step batches of worlds on paper46 with each number of threads, and single worlds of one density with one."""
    from warehouse_env.maps.layouts import make_layout
    from warehouse_env.simulation.simulator import Simulator

    for worlds, robots in ((64, 16), (1024, 32), (1, 32), (1, 256), (1, 1024)):
        if worlds == 1 and robots > budget.largest:
            continue
        config = EnvConfig(num_agents=robots, planner=_PLANNER, action_repeat=1)
        side = _SQUARE_PER_ROBOTS[robots] if worlds == 1 else 0
        grid = make_layout("blocks", rows=side, columns=side) if worlds == 1 else None
        sim = Simulator(config.replace(max_steps=sys.maxsize), worlds, grid=grid)
        sim.reset([budget.seed + k % _START_SEEDS for k in range(worlds)])
        pool = _draws(sim.action_space, budget.seed, worlds, robots)
        for threads in budget.threads if worlds > 1 else (1,):
            if threads > MOST_THREADS:
                continue
            set_num_threads(threads)
            measured = rate(lambda k, sim=sim, pool=pool: sim.step(pool[k % _POOL]), budget.seconds)  # type: ignore[misc]
            yield _speed(measured, worlds, robots, threads)
    set_num_threads(MOST_THREADS)


def reference(budget: Budget) -> Iterator[Row]:
    """Compare the step with fixed work in C, or in a kernel where there is no compiler, in turns."""
    from train.benchmarks.reference import reference as hold

    set_num_threads(1)
    yield from hold(max(5, round(_TURNS * budget.seconds)), budget.seed, budget.each_reference)
    set_num_threads(MOST_THREADS)


def pettingzoo(budget: Budget) -> Iterator[Row]:
    """Step one parallel PettingZoo environment with 8 robots."""
    from warehouse_env import parallel_env

    set_num_threads(1)
    env = parallel_env(num_agents=8, planner=_PLANNER, max_steps=sys.maxsize)
    env.reset(seed=budget.seed)
    draws = _draws(env.action_space(env.agents[0]), budget.seed, 8)
    pool = [dict(zip(env.agents, draw, strict=True)) for draw in draws]
    yield _speed(rate(lambda k: env.step(pool[k % _POOL]), budget.seconds), 1, 8, 1)


def vec_env(budget: Budget) -> Iterator[Row]:
    """Step the VecEnv of stable-baselines3 with 64 worlds of 16 robots."""
    from warehouse_env import vec_env as make

    set_num_threads(1)
    env = make(64, num_agents=16, planner=_PLANNER, max_steps=sys.maxsize)
    env.seed(budget.seed)
    env.reset()
    pool = _draws(env.action_space, budget.seed, 64 * 16)
    yield _speed(rate(lambda k: env.step(pool[k % _POOL]), budget.seconds), 64, 16, 1)


def policy(budget: Budget) -> Iterator[Row]:
    """Drive 64 robots a world with a learned policy: the steps alone, the decisions alone, and both in turn.

    Where the two hinder each other, as threads of a BLAS and of the step can, the parts are less than the whole.
    """
    from agents import make_policy, policy_config
    from warehouse_env.simulation.simulator import Simulator

    config = policy_config(_POLICY, EnvConfig(num_agents=64, planner=_PLANNER, max_steps=sys.maxsize))
    decider, rng = make_policy(_POLICY, config), np.random.default_rng(budget.seed)
    for worlds, threads in [(1, 1), *((4, threads) for threads in budget.threads if threads <= MOST_THREADS)]:
        set_num_threads(threads)
        sim = Simulator(config, worlds)
        actions = decider.act(sim.reset(budget.seed), rng)
        step = rate(lambda _, sim=sim, actions=actions: sim.step(actions), budget.seconds)  # type: ignore[misc]
        decision = rate(lambda _, sim=sim: decider.act(sim.observation, rng), budget.seconds)  # type: ignore[misc]
        both = rate(lambda _, sim=sim: sim.step(decider.act(sim.observation, rng)), budget.seconds)  # type: ignore[misc]
        seconds = {"step": 1 / step.median, "decision": 1 / decision.median}
        whole = sum(seconds.values())
        yield {
            **_speed(both, worlds, 64, threads), **{f"{part}_ms": 1000 * spent for part, spent in seconds.items()},
            "parts_over_whole": whole * both.median, "policy": _POLICY,
            "shares": {part: spent / whole for part, spent in seconds.items()},
        }  # fmt: skip
    set_num_threads(MOST_THREADS)


def training(budget: Budget) -> Iterator[Row]:
    """Run the trainers in turns: agent-steps/s, and the shares of simulator, policy and update."""
    from train.benchmarks.trainers import training as train

    yield from train(_TRAINED * budget.seconds, budget.seed)


def plan(budget: Budget) -> Iterator[Row]:
    """Run every planner on the named tasks of paper46: median milliseconds of a plan."""
    from warehouse_env.maps.layouts import NAMED_TASKS, make_layout
    from warehouse_env.planning import PLANNERS, make_planner

    layout = "paper46"
    grid, tasks = make_layout(layout), list(NAMED_TASKS[layout].values())
    for name in PLANNERS:
        planner, rng = make_planner(name), np.random.default_rng(budget.seed)
        planner.plan(grid, tasks[0].start, tasks[0].goal, rng)
        begin = time.perf_counter()
        seconds: list[float] = []
        while len(seconds) < 2 * len(tasks) or (time.perf_counter() - begin < budget.seconds and len(seconds) < 2000):
            task = tasks[len(seconds) % len(tasks)]
            seconds.append(planner.plan(grid, task.start, task.goal, rng).seconds)
        yield {"planner": name, "ms": 1000 * statistics.median(seconds), "on": layout, "plans": len(seconds)}


_FIRST_STEP = (
    "from warehouse_env import parallel_env; env = parallel_env(num_agents=8, planner='astar'); env.reset(seed=0); "
    "env.step({agent: 0 for agent in env.agents})"
)


def start(budget: Budget) -> Iterator[Row]:
    """Time a fresh interpreter up to `import warehouse_env`, and up to the first step of an environment [s]."""
    repeats = 3 if budget.seconds < 1 else 5
    importing = "import warehouse_env"
    for step, code in ((importing, importing), ("first step of an environment", _FIRST_STEP)):
        timed: str = f"import time; begin = time.perf_counter(); {code}; print(time.perf_counter() - begin)"
        seconds: list[float] = []
        for _ in range(repeats + 1):  # the first fills the caches
            done = subprocess.run([sys.executable, "-c", timed], capture_output=True, text=True, check=True)
            seconds.append(float(done.stdout.split()[-1]))
        yield {"step": step, "seconds": statistics.median(seconds[1:])}


PARTS: dict[str, Callable[[Budget], Iterator[Row]]] = {
    part.__name__: part for part in (simulator, reference, pettingzoo, vec_env, policy, training, plan, start)
}
