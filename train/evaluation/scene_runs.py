"""Scenes played side by side, one world a seed -> one row a seed: did all robots arrive in time?"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from train.evaluation.rollout import Watcher, config_of, make_actor
from train.evaluation.scenes import SCENES, Scene
from train.reporting.report import Table, grouped, number
from train.reporting.rows import Row, plain, wilson_interval
from warehouse_env import __version__
from warehouse_env.config import EnvConfig
from warehouse_env.routes.book import RouteBook
from warehouse_env.simulation.record.jam_log import JamLog
from warehouse_env.simulation.simulator import Simulator

WORLDS = 200  # side by side
NOTE = (
    "resolved: all robots arrived within the time [95% interval by Wilson's score]; seconds: until the last one "
    "arrived, mean over the resolved ones; collisions and deadlocks: means over all seeds."
)


def play_scene(
    name: str,
    policy: str,
    base: EnvConfig,
    seconds: float,
    seeds: Sequence[int],
    tick: Callable[[int], None],
    chosen: Mapping[str, Any] = {},
    watch: Sequence[Watcher] = (),
) -> list[Row]:
    """Play a scene of SCENES once a seed, for at most `seconds`; return a row each.

    A row does not depend on the other seeds: the policy is asked for one world at a time, with a generator of its own.
    tick is told how many seeds are done; for chosen see rollout.config_of. watch: called with each Simulator.
    """
    scene = SCENES[name]()
    config = config_of(policy, base.replace(num_agents=scene.robots, tasks="one_shot"), chosen)
    steps = max(1, round(seconds / (config.time_step * config.action_repeat)))
    config = config.replace(max_steps=steps)
    shared = {"scene": name, "policy": policy, "robots": scene.robots, "planner": config.planner}
    rows: list[Row] = []
    book: RouteBook | None = None
    for first in range(0, len(seeds), WORLDS):
        part = seeds[first : first + WORLDS]
        simulator = Simulator(config, len(part), grid=None if book else scene.grid, routes=book)
        book = simulator.route_book
        played = _play(simulator, scene, policy, part, watch)
        about = {"config": config.to_dict(), "version": __version__}
        rows += [plain({**shared, "seed": seed, **row, **about}) for seed, row in zip(part, played, strict=True)]
        tick(len(rows))
    return rows


def _play(simulator: Simulator, scene: Scene, policy: str, seeds: Sequence[int], watch: Sequence[Watcher]) -> list[Row]:
    """Play the seeds side by side until all robots of all worlds have arrived, or time is up."""
    config = simulator.config
    act = make_actor(policy, config)
    rngs = [np.random.default_rng([seed, 1]) for seed in seeds]
    observation = simulator.reset_to([scene.draw(np.random.default_rng([seed, 2])) for seed in seeds], list(seeds))
    log = JamLog(simulator)
    going = list(range(len(seeds)))
    steps = 0
    for watcher in watch:
        watcher(simulator, steps)
    while steps < config.max_steps and going:
        given = [act(observation[world : world + 1], rngs[world]) for world in going]
        actions = np.zeros((len(seeds), *given[0].shape[1:]), given[0].dtype)  # nobody drives where all have arrived
        actions[going] = np.concatenate(given)
        observation = simulator.step(actions)
        steps += 1
        log(simulator, steps)
        for watcher in watch:
            watcher(simulator, steps)
        for world in [world for world in going if simulator.terminated[world].all()]:
            log.close(simulator, world)
            going.remove(world)
    for world in going:
        log.close(simulator, world)
    return [_row(simulator, world, log) for world in range(len(seeds))]


def _row(simulator: Simulator, world: int, log: JamLog) -> Row:
    metrics = simulator.episode_metrics(world)
    arrived = int((simulator.robots[world]["goals"] > 0).sum())
    return {
        "resolved": arrived == simulator.num_agents,
        "arrived": arrived,
        "makespan_s": metrics["makespan_s"],
        "collisions_robot": metrics["collisions_robot"],
        "collisions_shelf": metrics["collisions_shelf"],
        "collisions_person": metrics["collisions_person"],
        "longest_standing_s": metrics["longest_standing_s"],
        **log.metrics(world),
    }


def scene_table(rows: Sequence[Row]) -> Table:
    """Return one line for each scene and policy."""
    header = ("scene", "robots", "policy", "seeds", "resolved %", "seconds", "collisions", "deadlocks")
    cells = []
    for (name, robots, policy), group in grouped(rows, ("scene", "robots", "policy")).items():
        resolved = [row for row in group if row["resolved"]]
        share, low, high, _ = wilson_interval(len(resolved), len(group))
        kinds = ("collisions_robot", "collisions_shelf", "collisions_person")
        mean = [float(np.mean([row.get(kind, 0.0) for row in group])) for kind in kinds]
        seconds = float(np.mean([row["makespan_s"] for row in resolved])) if resolved else float("nan")
        deadlocks = float(np.mean([row["deadlocks"] for row in group]))
        cells.append((
            str(name), str(robots), str(policy), str(len(group)),
            f"{100 * share:.1f} [{100 * low:.1f}, {100 * high:.1f}]", number(seconds), number(sum(mean)),
            number(deadlocks),
        ))  # fmt: skip
    return Table("Scenes", header, tuple(cells), NOTE)
