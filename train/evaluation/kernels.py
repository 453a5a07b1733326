"""Compile all kernels ahead of time, in several processes.

The first call of a kernel compiles it and keeps it on disk. Each part here is a tiny run that calls other kernels first
than the parts beside it, and loads what these have kept meanwhile. No part names a kernel.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from train.evaluation.audit.watcher import Audit
from train.evaluation.jobs import Job, Result, Runner, Tick
from train.evaluation.processes import Processes
from train.evaluation.rollout import make_experiment, run
from train.execute.drive import Drive
from train.execute.lifelong import plan_lifelong
from train.execute.motions import Curves
from train.execute.order import find_order
from train.reporting.rows import Row, RowFile
from warehouse_env import EnvConfig, SensorSpec, Simulator, TrafficSpec, UncertaintySpec, parallel_env
from warehouse_env.compiled import is_kept
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import make_planner
from warehouse_env.simulation.step import run as step_worlds
from warehouse_env.simulation.traffic.live import FINDERS

if TYPE_CHECKING:  # torch may not be installed yet
    import torch

    from warehouse_env.simulation.device.simulator import DeviceSimulator

_BARE = EnvConfig(num_agents=4, layout="open", planner="astar", max_steps=20)
_CROWD = EnvConfig(num_agents=24, layout="narrow")  # crowded: robots stand, replan and recover
_SECONDS = 60.0  # [s] simulated, in about a second


def is_compiled() -> bool:
    """Return whether the step of this version is on disk; other kernels are compiled when called."""
    return is_kept(step_worlds)


@dataclass(frozen=True)
class _Part(Job):
    """A tiny run."""

    name: str
    call: Callable[[], None]

    titled = "compiling, once for this version: {name}"

    def run(self, tick: Tick) -> Result:
        """Call the kernels."""
        begin = time.perf_counter()
        self.call()
        return Result([{"what": "compile", "part": self.name, "seconds": time.perf_counter() - begin}])


def compile_for_card(config: EnvConfig, capability: str) -> None:
    """Compile what a reset and a step launch on GPUs of a compute capability."""
    from warehouse_env.simulation.device.simulator import DeviceSimulator

    simulator = DeviceSimulator(config, device=f"compiler:{capability}")
    simulator.reset(0)
    simulator.step(no_actions(simulator))


def no_actions(simulator: DeviceSimulator) -> torch.Tensor:
    """Return actions of zeros for all worlds."""
    import torch

    space = simulator.host.action_space
    shape = (simulator.num_worlds, simulator.num_agents, *(space.shape or ()))
    return torch.from_numpy(np.zeros(shape, space.dtype))


def compile_all(processes: int, capabilities: Sequence[str] = ()) -> list[Row]:
    """Run all parts under a progress bar; return a row with the seconds of each.

    capabilities: of GPUs for which kernels are compiled as well, as "9.0".
    """
    parts = [_Part(name, call) for name, call in PARTS.items()]
    parts += [
        _Part(f"GPUs of compute capability {capability}, {name}", partial(compile_for_card, config, capability))
        for capability in capabilities for name, config in CARD_SETS.items()
    ]  # fmt: skip
    with Runner(RowFile(None), workers=Processes(processes)) as run_all:
        return run_all(parts)


def compile_missing(processes: int | None = None) -> None:
    """Compile all kernels, on all cores by default, unless the step is on disk."""
    if not is_compiled():
        compile_all(processes or os.cpu_count() or 1)


def _motion() -> None:
    """Compile the step without waiting for routes: robots without a reset do not move."""
    Simulator(_BARE).step(np.zeros((1, _BARE.num_agents), np.int64))


def _audit() -> None:
    simulator, audit = Simulator(_BARE), Audit(_BARE)
    for step in range(2):
        audit(simulator, step)


def _plans() -> None:
    grid = make_layout(_BARE.layout)
    cells = [(row, column) for row, column in grid.free_cells.tolist()]
    for name in (EnvConfig.planner, _BARE.planner):
        make_planner(name).plan(grid, cells[0], cells[-1], np.random.default_rng(0))


def _traffic() -> None:
    for planner in FINDERS:
        run(make_experiment("shielded", _CROWD.replace(planner=planner), 1, _SECONDS, 0))


def _each() -> None:
    """Compile the step for other sets of features and observations."""
    for policy in ("greedy", "ppo"):
        run(make_experiment(policy, _BARE, 1, _SECONDS, 0))


def _bare() -> None:
    run(make_experiment("follow", _CROWD, 1, _SECONDS, 0))
    for action_type in ("continuous", "raw"):
        simulator = Simulator(_BARE.replace(action_type=action_type))
        simulator.reset(0)
        simulator.step(np.zeros((1, _BARE.num_agents, 2), np.float32))


def _environment() -> None:
    env = parallel_env(num_agents=4, layout="open", planner="astar")
    env.reset(seed=0)
    for _ in range(3):
        env.step({agent: env.action_space(agent).sample() for agent in env.agents})


def _grid_plans() -> None:
    curves = Curves(Simulator(_BARE.replace(num_agents=1, action_type="raw")))
    plan = plan_lifelong("pibt", _BARE, 8, 1, 0)
    Drive(find_order(plan, curves), curves, _BARE.replace(action_type="raw")).step(np.zeros(_BARE.num_agents, np.bool_))


PARTS: dict[str, Callable[[], None]] = {
    "one robot's motion": _motion,
    "routes of ants and searches": _plans,
    "right of way, live routes, predictions": _traffic,
    "right of way without predictions, and these alone": _each,
    "all options off": _bare,
    "the environment": _environment,
    "plans of grid planners": _grid_plans,
    "the audit": _audit,
}

_RULES = TrafficSpec(shield=True, right_of_way=True)  # whose kernels without right of way are those of the shield
_PREDICTIONS = SensorSpec(predictions=True)
_ERRORS = UncertaintySpec(pose_error=0.01, heading_error=0.01, actuation_error=0.01, loss=0.1)
CARD_SETS: dict[str, EnvConfig] = {  # each has kernels of its own on a GPU; other sets are compiled at their first step
    "all options off": _BARE,
    "predictions": _BARE.replace(sensor=_PREDICTIONS),
    "raw actions": _BARE.replace(action_type="raw"),
    "right of way, shield": _BARE.replace(traffic=_RULES),
    "right of way, shield, predictions": _BARE.replace(traffic=_RULES, sensor=_PREDICTIONS),
    "errors and lost messages": _BARE.replace(traffic=TrafficSpec(shield=True), uncertainty=_ERRORS),
}
