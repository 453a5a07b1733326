"""The measurements of `warehouse bench`: each part yields rows. Heavy imports stay inside the parts."""

import statistics
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.benchmarks.timing import speeds
from train.books import book_of
from train.reporting.rows import Row
from warehouse_env.config import EnvConfig
from warehouse_env.threads import MOST_THREADS, set_num_threads
from warehouse_env.traffic_spec import read_traffic

Part = Callable[[float], Iterator[Row]]
"""Measures for about so many seconds a row."""

_PLANNER = "astar"  # fast to plan
_SEED = 0  # of worlds and random actions
_THREADS = (1, 2)  # of batches of worlds
_POOL = 32  # random actions, drawn before the clock starts and then cycled
_TRAINED = 5  # seconds of each training per second of its budget
_TURNS = 3  # chunks of the step and its reference per second of its budget
_TRAINING_TURNS = 5
_WARM_UP = 3  # updates of a training before the clock starts, which load kernels
_START_SEEDS = 16  # large batches repeat these starts: planning 30,000 routes is not what is measured
_ON_CARD = (  # worlds, robots, traffic
    (65536, 16, "none"), (65536, 16, "shield:routes=false"), (65536, 16, "rules:routes=false"),
    (16384, 64, "none"), (4096, 16, "none"),
)  # fmt: skip
_SQUARE_PER_ROBOTS = {32: 46, 256: 130, 1024: 260}  # robots -> side of the floor [cells], at one density


def _draws(space: Any, *shape: int) -> NDArray[np.int64]:
    """Return int64[_POOL, *shape], random actions of a discrete space."""
    return np.random.default_rng(_SEED).integers(0, space.n, (_POOL, *shape))


def _speed(call: Callable[[int], object], envs: int, agents: int, threads: int, seconds: float) -> Row:
    """Return a row of calls that step `envs` environments of `agents` robots each."""
    (row,) = speeds([(call, envs * agents)], seconds)
    return {"envs": envs, "agents": agents, "threads": threads, **row}


def simulator(seconds: float) -> Iterator[Row]:
    """Step batches of worlds on paper46 with each number of threads, and single worlds of one density with one."""
    from warehouse_env.maps.layouts import make_layout
    from warehouse_env.simulation.simulator import Simulator

    for worlds, robots in ((64, 16), (1024, 32), (1, 32), (1, 256), (1, 1024)):
        config = EnvConfig(num_agents=robots, planner=_PLANNER, action_repeat=1)
        side = _SQUARE_PER_ROBOTS[robots] if worlds == 1 else 0
        grid = make_layout("blocks", rows=side, columns=side) if worlds == 1 else None
        sim = Simulator(config.replace(max_steps=sys.maxsize), worlds, grid=grid)
        sim.reset([_SEED + k % _START_SEEDS for k in range(worlds)])
        pool = _draws(sim.action_space, worlds, robots)
        for threads in _THREADS if worlds > 1 else (1,):
            if threads > MOST_THREADS:
                continue
            set_num_threads(threads)
            yield _speed(
                lambda k, sim=sim, pool=pool: sim.step(pool[k % _POOL]),  # type: ignore[misc]
                worlds, robots, threads, seconds,
            )  # fmt: skip


def reference(seconds: float) -> Iterator[Row]:
    """Compare the step with fixed work in C, in turns."""
    from train.benchmarks.reference import reference as hold

    set_num_threads(1)
    yield from hold(max(5, round(_TURNS * seconds)), _SEED)


def pettingzoo(seconds: float) -> Iterator[Row]:
    """Step one parallel PettingZoo environment with 8 robots."""
    from warehouse_env import parallel_env

    set_num_threads(1)
    env = parallel_env(num_agents=8, planner=_PLANNER, max_steps=sys.maxsize)
    env.reset(seed=_SEED)
    draws = _draws(env.action_space(env.agents[0]), 8)
    pool = [dict(zip(env.agents, draw, strict=True)) for draw in draws]
    yield _speed(lambda k: env.step(pool[k % _POOL]), 1, 8, 1, seconds)


def vec_env(seconds: float) -> Iterator[Row]:
    """Step the VecEnv of stable-baselines3 with 64 worlds of 16 robots."""
    from warehouse_env import vec_env as make

    set_num_threads(1)
    env = make(64, num_agents=16, planner=_PLANNER, max_steps=sys.maxsize)
    env.seed(_SEED)
    env.reset()
    pool = _draws(env.action_space, 64 * 16)
    yield _speed(lambda k: env.step(pool[k % _POOL]), 64, 16, 1, seconds)


def cuda(seconds: float) -> Iterator[Row]:
    """Step worlds on a GPU at full speed along their routes with a fifth of random commands, observed each step."""
    import torch

    from warehouse_env.simulation.device.simulator import DeviceSimulator

    rng = np.random.default_rng(_SEED)
    for worlds, robots, traffic in _ON_CARD:
        config = EnvConfig(num_agents=robots, max_steps=sys.maxsize, traffic=read_traffic(traffic), quick_searches=True)
        sim = DeviceSimulator(config, worlds, device="cuda", routes=book_of(config))
        sim.reset(_SEED)
        commands = np.full((_POOL, worlds, robots), sim.host.cruise_action)
        random = rng.random(commands.shape) < 0.2
        commands[random] = rng.integers(0, len(sim.host.actions.table), int(random.sum()))
        pool = torch.from_numpy(commands).to(sim.device)
        row = _speed(lambda k, sim=sim, pool=pool: sim.step(pool[k % _POOL]), worlds, robots, 1, seconds)  # type: ignore[misc]
        yield {**row, "traffic": traffic, "card": torch.cuda.get_device_name(sim.device)}


def peers(seconds: float) -> Iterator[Row]:
    """Step this simulator, VMAS, JaxNav and CAMAR in turns, on one core or on a GPU."""
    from train.benchmarks.peers import peers as measured

    set_num_threads(1)
    yield from measured(seconds)


def training(seconds: float) -> Iterator[Row]:
    """Run the trainers with fixed routes in turns: agent-steps/s of the whole loop, and shares of its time."""
    from train.learning.recipes import by_recipe
    from train.learning.trainer import profile
    from train.trainers import trainer_of

    measured = []
    for recipe in ("fixed_routes_reinforce", "fixed_routes", "fixed_routes_ppo"):
        config = by_recipe(recipe, seed=_SEED)
        trainer = trainer_of(config)
        update = profile(trainer, 1, _WARM_UP)["seconds"]
        updates = max(1, round(_TRAINED * seconds / _TRAINING_TURNS / update))
        measured.append((config, trainer, updates, list[dict[str, float]]()))
    for _ in range(_TRAINING_TURNS):
        for _, trainer, updates, turns in measured:
            turns.append(profile(trainer, updates, 0))
    for config, _, _, turns in measured:
        rates = [turn["steps_per_second"] for turn in turns]
        split = {part: sum(turn[part] for turn in turns) for part in ("simulator_s", "policy_s", "update_s")}
        yield {
            "what": f"train {config.recipe}", "trainer": config.algorithm, "threads": config.threads,
            "envs": sum(count for _, count in config.worlds(config.rows)), "agents": "/".join(map(str, config.robots)),
            "hidden": list(config.hidden), "agent_steps_per_s": statistics.median(rates), "low": min(rates),
            "high": max(rates),
            "shares": {part.removesuffix("_s"): seconds / sum(split.values()) for part, seconds in split.items()},
        }  # fmt: skip


PARTS: dict[str, Part] = {
    part.__name__: part for part in (simulator, reference, pettingzoo, vec_env, cuda, training, peers)
}
