"""Agent-steps/s beside VMAS, JaxMARL's JaxNav and CAMAR, in turns in one process.

Each runs its navigation task with random actions, and computes observations and rewards every step. Compiling and
resets are not timed.
"""

import contextlib
import os
import time
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import torch

from train.benchmarks.timing import Call, speeds
from train.reporting.rows import Row
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.errors import WarehouseError
from warehouse_env.simulation.device.simulator import DeviceSimulator
from warehouse_env.simulation.simulator import Simulator

SIZES = (1, 64, 1024)  # worlds
ROBOTS = 16
RAYS = 32  # of every lidar; CAMAR observes the nearest discs instead
POOL = 16  # random actions, drawn before the clock starts and then cycled
JAX_STEPS = 128  # most steps of one world in a compiled loop


def _ours(worlds: int, device: str) -> Call:
    config = EnvConfig(num_agents=ROBOTS, max_steps=10**9, sensor=SensorSpec(rays=RAYS))
    sim: Any = Simulator(config, worlds) if device == "cpu" else DeviceSimulator(config, worlds, device=device)
    sim.reset(0)
    choices = len(config.speed_levels) * len(config.lateral_offsets)
    pool: Any = torch.randint(choices, (POOL, worlds, ROBOTS), device=device)
    pool = pool.numpy() if device == "cpu" else pool
    return lambda k: sim.step(pool[k % POOL]), worlds * ROBOTS


def _vmas(worlds: int, device: str) -> Call:
    from vmas import make_env

    torch.set_num_threads(1)
    env = make_env("navigation", worlds, device, seed=0, n_agents=ROBOTS, n_lidar_rays=RAYS)
    pool = [env.get_random_actions() for _ in range(POOL)]
    return lambda k: env.step(pool[k % POOL]), worlds * ROBOTS


def _jaxnav(worlds: int, device: str) -> Call:
    import jax
    from jaxmarl.environments.jaxnav import JaxNav

    env = JaxNav(ROBOTS, lidar_num_beams=RAYS)

    def draw(key: Any) -> Any:
        return {agent: env.action_space(agent).sample(jax.random.fold_in(key, k)) for k, agent in enumerate(env.agents)}

    return _compiled(env.reset, env.step_env, draw, worlds)


def _camar(worlds: int, device: str) -> Call:
    from camar import camar_v0

    env = camar_v0(map_kwargs={"num_agents": ROBOTS})  # a random grid
    return _compiled(env.reset, env.step, env.action_spaces.sample, worlds)


def _compiled(reset: Any, step: Any, draw: Any, worlds: int) -> Call:
    """Return a call that does several steps in one compiled loop."""
    import jax

    steps = max(1, JAX_STEPS // worlds)
    keys = jax.random.split(jax.random.key(0), worlds)
    pool = jax.vmap(lambda key: jax.vmap(draw)(jax.random.split(key, worlds)))(jax.random.split(keys[0], steps))

    def one(carry: tuple[Any, ...], actions: Any) -> tuple[tuple[Any, ...], None]:
        return jax.vmap(step)(keys, carry[1], actions)[:3], None  # observation, state, reward

    first, _ = jax.jit(one)((None, jax.jit(jax.vmap(reset))(keys)[1]), jax.tree.map(lambda array: array[0], pool))
    loop, held = jax.jit(lambda carry, actions: jax.lax.scan(one, carry, actions)[0]), [first]

    def call(_: int) -> None:
        held[0] = jax.block_until_ready(loop(held[0], pool))

    return call, steps * worlds * ROBOTS


PEERS = {"warehouse-env": _ours, "vmas": _vmas, "jaxmarl": _jaxnav, "camar": _camar}  # by package


def peers(seconds: float) -> Iterator[Row]:
    """Yield a row for each size and installed package; WarehouseError if no peer is installed.

    seconds: of a row. Processor time of one core counts, or wall time on a GPU where there is one.
    """
    made = {}
    for package, make in PEERS.items():
        with contextlib.suppress(PackageNotFoundError):
            made[f"{package} {version(package)}"] = make
    if len(made) < 2:
        raise WarehouseError("no peer is installed: pip install vmas jaxmarl camar, or one of them")
    device = "cuda" if torch.cuda.is_available() else "cpu"
    os.environ.setdefault("JAX_PLATFORMS", device)
    if device == "cpu" and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # for the threads of all libraries
    clock = time.process_time if device == "cpu" else _card_s
    for worlds in SIZES:
        rows = speeds([make(worlds, device) for make in made.values()], seconds, clock)
        for name, row in zip(made, rows, strict=True):
            yield {"simulator": name, "device": device, "envs": worlds, "agents": ROBOTS, "threads": 1, **row}


def _card_s() -> float:
    """Return the time once the GPU has done what it was given [s]."""
    torch.cuda.synchronize()
    return time.perf_counter()
