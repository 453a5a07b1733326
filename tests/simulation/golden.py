"""An episode and digests recorded once and kept: what is computed must not change unnoticed.

`python -m tests.simulation.golden` records them anew, for a change that is meant to change results.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import Actor, make_policy, policy_config
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.maps.layouts import LAYOUTS
from warehouse_env.simulation.record.recording import Recorder
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import field_of
from warehouse_env.traffic_spec import UncertaintySpec

DATA = Path(__file__).parent / "data"
DIGESTS = DATA / "digests.json"
STEPS = 200
COUNTERS = ("goals", "hits_robot", "hits_shelf", "near_misses", "goal_row", "goal_col")

COMMON: dict[str, Any] = {"num_agents": 8, "action_repeat": 2, "sensor": SensorSpec(rays=4, neighbours=2)}
EPISODE = DATA / "discrete.npz"
# Each layout, and what else leads through code of its own.
CASES: dict[str, dict[str, Any]] = {f"{layout}, discrete": {"layout": layout} for layout in LAYOUTS} | {
    "paper46, continuous": {"layout": "paper46", "action_type": "continuous"},
    "paper46, raw": {"layout": "paper46", "action_type": "raw"},
    "pillars, raw": {"layout": "pillars", "action_type": "raw"},
    "paper46_rough, pf_aco": {"layout": "paper46_rough", "planner": "pf_aco"},
    "narrow, one shot": {"layout": "narrow", "tasks": "one_shot"},
    "paper46, no lanes": {"layout": "paper46", "keep_right": 0.0},
}
# What README's figures are driven with: policies under field, right of way and live routes. Env steps, then what the
# config differs in. Long enough that robots wait in rings, make room, are settled and take better routes.
STACKS: dict[str, tuple[str, int, dict[str, Any]]] = {
    "greedy, 128 on narrow": ("greedy", 500, {"num_agents": 128, "layout": "narrow"}),
    "greedy, 32, one shot": ("greedy", 900, {"num_agents": 32, "tasks": "one_shot"}),
    "greedy, 64 on a drawn floor, people": ("greedy", 500, {"num_agents": 64, "layout": "aisles:seed=77", "people": 6}),
    "shielded, 32": ("shielded", 600, {"num_agents": 32}),
    "shielded, 32, routes searched": ("shielded", 600, {"num_agents": 32, "planner": "astar_turns"}),
    "shielded, 64, messages lost": (
        "shielded", 500, {"num_agents": 64, "uncertainty": UncertaintySpec(loss=0.2)}
    ),
    "shielded, 32 on single_lane, people": (
        "shielded", 600, {"num_agents": 32, "layout": "single_lane", "people": 6}
    ),
    "unshielded, 32": ("unshielded", 400, {"num_agents": 32, "layout": "narrow"}),
}  # fmt: skip
EVENTS = ("reroutes", "near_misses", "goals", "waited")


def actions_for(kind: str, worlds: int, robots: int, seed: int = 4) -> Iterator[NDArray[Any]]:
    """Yield STEPS actions of mostly driving ahead, so that robots get about and meet."""
    rng = np.random.default_rng(seed)
    for _ in range(STEPS):
        if kind == "discrete":
            yield rng.choice([0, 5, 10, 15, 16, 17], (worlds, robots), p=[0.05, 0.05, 0.1, 0.6, 0.1, 0.1])
        else:
            yield rng.uniform(-0.6, 1.0, (worlds, robots, 2)).astype(np.float32)


def digest(case: dict[str, Any]) -> str:
    """Return a digest of where all robots of two worlds were, how fast, and what they counted, step by step."""
    config = EnvConfig(**{"planner": "astar_turns:gentleness=10", **COMMON, **case})
    simulator = Simulator(config, 2)
    simulator.reset(seed=3)
    content = hashlib.blake2b(digest_size=16)
    for actions in actions_for(config.action_type, 2, config.num_agents):
        simulator.step(actions)
        for values in (simulator.state.pose, simulator.state.speed, simulator.state.steer):
            content.update(values.astype("<f4").tobytes())
        for name in COUNTERS:
            content.update(field_of(simulator.robots, name).astype("<i4").tobytes())
    return content.hexdigest()


def drive_stack(name: str) -> tuple[str, Simulator, dict[str, int]]:
    """Return a digest of all that a world gave step by step, its simulator, and how often its mechanisms stepped in."""
    policy_name, steps, changes = STACKS[name]
    config = policy_config(policy_name, EnvConfig(max_steps=steps, **changes))
    act, rng = Actor(make_policy(policy_name, config), config), np.random.default_rng(8)
    simulator = Simulator(config)
    simulator.reset(seed=5)
    content, seen = hashlib.blake2b(digest_size=16), {"retreating": 0, "arcs": 0, "yields_to": 0}
    for _ in range(steps):
        simulator.step(act(simulator.observation, rng))
        robots = simulator.robots
        for values in (simulator.state.pose, simulator.state.speed, simulator.state.steer, simulator.observation):
            content.update(values.astype("<f4").tobytes())
        content.update(simulator.reward.astype("<f4").tobytes())
        for counter in (*COUNTERS, *EVENTS):
            content.update(field_of(robots, counter).astype("<i4").tobytes())
        seen = {name: count + int((field_of(robots, name) > 0).sum()) for name, count in seen.items()}
    seen |= {event: int(field_of(simulator.robots, event).sum()) for event in EVENTS}
    return content.hexdigest(), simulator, seen


def record() -> None:
    """Write the episode and the digests."""
    config = EnvConfig(**COMMON, planner="astar_turns")
    recorder = Recorder(Simulator(config), (12,))
    for actions in actions_for(config.action_type, 1, config.num_agents):
        recorder.step(actions)
    recorder.episode.save(EPISODE)
    found = {name: digest(case) for name, case in CASES.items()}
    for name in STACKS:
        found[name], _, counts = drive_stack(name)
        print(name, counts)
    DIGESTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    record()
