"""One experiment: an environment, a policy and seeds, played to the end -> one row per episode."""

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import Actor, LearnedPolicy, entry_of, make_policy, policy_config
from agents.policy import Recurrent
from train import epibt
from train.books import simulator_of
from train.evaluation.disturbances import DISTURBANCES, Breakdown, Senses
from train.job_files import floor_digest, versions
from train.reporting.rows import Row, plain
from warehouse_env import __version__
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, counted
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.record.waiting import WaitingRecord
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.traffic_spec import read_traffic, written_traffic

Watcher = Callable[[Simulator, int], None]
"""Called with the simulator and the number of steps done, after the reset (step 0) and after every step."""

Decider = Callable[[Simulator, Sequence[np.random.Generator]], NDArray[Any]]
"""The actions of all robots of all worlds, from the simulator and a generator a world."""

MOST = 1_000_000  # episodes of an experiment, runs of a planner, tasks
POLICY_STREAM = 1  # apart from the world's own stream SeedSequence([seed, 0])


@dataclass(frozen=True)
class Experiment:
    """An environment with its planner, a policy, and the seeds of the episodes."""

    policy: str  # a name of POLICIES, a policy folder, or the central planner's name
    config: EnvConfig  # as the policy needs it; max_steps is the length of an episode
    seed: int  # of episode 0; episode k has seed + k
    episodes: tuple[int, ...]  # the numbers of the episodes to play
    disturbance: str | None = None  # a name of DISTURBANCES, whose changes the config has

    @property
    def seeds(self) -> list[int]:
        """Seeds of the episodes."""
        return [self.seed + k for k in self.episodes]

    @property
    def driver(self) -> str:
        """The short name of the policy with its traffic, as in "greedy (rules)"."""
        return f"{Path(self.policy).name} ({written_traffic(self.config.traffic_spec)})"

    @property
    def title(self) -> str:
        """What the progress bar says."""
        spoiled = f" · {DISTURBANCES[self.disturbance].summary}" if self.disturbance else ""
        return f"{self.config.layout} · {counted(self.config.num_agents, 'robot')} · {self.policy}{spoiled}"


def config_of(policy: str, base: EnvConfig, chosen: Mapping[str, Any]) -> EnvConfig:
    """Return `base` with what the policy needs, overridden by the fields that a user has chosen.

    A chosen `traffic` may be a text for `read_traffic`, in which "own" stands for what the policy needs.
    """
    config = base.replace(**epibt.NEEDS) if policy == epibt.NAME else policy_config(policy, base)
    if isinstance(traffic := chosen.get("traffic"), str):
        chosen = {**chosen, "traffic": read_traffic(traffic, config.traffic_spec)}
    return config.replace(**chosen)


def make_experiment(
    policy: str, base: EnvConfig, episodes: int, seconds: float, seed: int, chosen: Mapping[str, Any] = {},
    disturbance: str | None = None,
) -> Experiment:  # fmt: skip
    """Return the experiment of `episodes` episodes of `seconds` simulated time in the config of `config_of`, disturbed.

    Raises ConfigError for an unknown policy or a number out of range, WeightsError for an unusable policy folder.
    """
    for wrong, given, must in (
        (episodes < 1, f"episodes={episodes}", "at least 1"),
        (episodes > MOST, f"episodes={episodes}", f"at most {MOST:,}"),
        (seconds > MOST * MOST, f"seconds={seconds!r}", f"at most {MOST * MOST:,}"),
        (not (math.isfinite(seconds) and seconds > 0), f"seconds={seconds!r}", "a finite number above 0"),
        (seed < 0, f"seed={seed}", "at least 0"),
    ):
        if wrong:
            raise ConfigError(f"{given} must be {must}")
    config = config_of(policy, base, chosen)
    check_driver(policy, config, disturbance)
    if disturbance is not None:
        config = DISTURBANCES[disturbance].config(config)
    steps = max(1, round(seconds / (config.time_step * config.action_repeat)))
    return Experiment(policy, config.replace(max_steps=steps), seed, tuple(range(episodes)), disturbance)


def summary_of(policy: str) -> str:
    """Describe a policy, or the central planner, in a line; ConfigError for an unknown one."""
    return epibt.SUMMARY if policy == epibt.NAME else entry_of(policy).summary


def check_driver(policy: str, config: EnvConfig, disturbance: str | None = None) -> None:
    """Raise what prevents a policy, or the central planner, from driving in a config."""
    if policy != epibt.NAME:
        make_policy(policy, config)
    elif disturbance is not None:
        raise ConfigError(f"{policy} sees the state of all robots, not observations that a disturbance could change")
    else:
        epibt.check_config(config)


def run(experiment: Experiment, watch: Sequence[Watcher] = (), grid: GridMap | None = None) -> list[Row]:
    """Play all episodes side by side, one world each; return their rows in the order of their seeds.

    grid: instead of that which the config names. An episode's numbers do not depend on the others: every world has its
    own generators, and the policy sees one world at a time. ms_per_step is the median time of a decision of one world,
    policy and simulator together, so that compiling does not count.
    """
    simulator = simulator_of(experiment.config, len(experiment.seeds), grid)
    simulator.reset(experiment.seeds)
    measured, ms_per_step = play_out(experiment, simulator, watch)
    return [_row(experiment, k, values, ms_per_step) for k, values in zip(experiment.episodes, measured, strict=True)]


def play_out(
    experiment: Experiment, simulator: Simulator, watch: Sequence[Watcher] = (),
    step: Callable[[NDArray[Any]], object] | None = None,
) -> tuple[list[dict[str, Any]], float]:  # fmt: skip
    """Drive the worlds of an experiment, just reset, until all episodes are over.

    step: instead of the simulator's own. Returns each episode's metrics, deadlocks included, and the median time of a
    decision [ms].
    """
    decide, step = decider(experiment), step or simulator.step
    generators = [np.random.default_rng([seed, POLICY_STREAM]) for seed in experiment.seeds]
    metrics: dict[int, dict[str, Any]] = {}
    after = DISTURBANCES[experiment.disturbance].breakdown if experiment.disturbance else None
    watch = watch if after is None else [*watch, Breakdown(after, experiment.seeds)]
    waiting = WaitingRecord(simulator)
    seconds: list[float] = []
    for steps in range(experiment.config.max_steps + 1):
        if steps:
            begin = time.perf_counter()
            step(decide(simulator, generators))
            seconds.append((time.perf_counter() - begin) / (simulator.num_worlds - len(metrics)))
            waiting(simulator, steps)
        for watcher in watch:
            watcher(simulator, steps)
        # A world is measured as soon as it is over; then it idles until the last one is over.
        over = simulator.terminated.all(axis=1) | (steps == experiment.config.max_steps)
        for world in [world for world in np.flatnonzero(over).tolist() if world not in metrics]:
            kept = {"deadlocks": float(waiting.deadlocks[world]), "longest_standing_why": waiting.longest[world][1]}
            metrics[world] = {**simulator.episode_metrics(world), **kept}
        if len(metrics) == simulator.num_worlds:
            break
    return [metrics[world] for world in range(simulator.num_worlds)], 1000 * statistics.median(seconds)


def decider(experiment: Experiment) -> Decider:
    """Return what chooses the actions from what the robots observe; the central planner sees all."""
    if experiment.policy == epibt.NAME:
        return epibt.Epibt(experiment.config, len(experiment.seeds)).act
    config, name, eyes = experiment.config, experiment.disturbance, list[Senses]()
    if name is not None:  # which may give other commands than the policy was made for
        eyes = [Senses(DISTURBANCES[name], config, seed) for seed in experiment.seeds]
        config = config.replace(speed_levels=config_of(experiment.policy, config, {}).speed_levels)
    act = make_actors(experiment.policy, config, len(experiment.seeds))

    def decide(simulator: Simulator, generators: Sequence[np.random.Generator]) -> NDArray[Any]:
        seen = [simulator.observation[b : b + 1] for b in range(len(generators))]
        seen = [eye.see(row) for eye, row in zip(eyes, seen, strict=True)] if eyes else seen
        going = np.flatnonzero(~simulator.terminated.all(axis=1)).tolist()
        given = [act[world](seen[world], generators[world]) for world in going]
        actions = np.zeros((len(generators), *given[0].shape[1:]), given[0].dtype)  # nobody drives where all are parked
        actions[going] = np.concatenate(given)
        return actions

    return decide


def make_actors(name: str, config: EnvConfig, worlds: int) -> list[Actor]:
    """Return an actor for each world. They share a policy, unless it may keep a memory of its own without saying so."""
    first = make_policy(name, config)
    shared = isinstance(first, (LearnedPolicy, Recurrent))
    policies = [first if shared or not world else make_policy(name, config) for world in range(worlds)]
    return [Actor(policy, config) for policy in policies]


def identity(experiment: Experiment) -> Row:
    """Return the fields that all rows of an experiment share and that identify them in a file."""
    config = experiment.config
    shared = {"policy": experiment.policy, "layout": config.layout, "robots": config.num_agents}
    if experiment.disturbance is not None:
        strengths = DISTURBANCES[experiment.disturbance].strengths
        shared |= {"disturbance": experiment.disturbance, "strengths": strengths}
    orders = (config.orders and config.orders.file) or ""
    plugins = config.planner, config.layout, config.tasks, config.sensor.extra or ""
    made_of = versions(experiment.policy, *plugins, orders=orders)
    if floor := floor_digest(config.layout):
        made_of[config.layout] = floor
    if made_of:
        shared["versions"] = made_of
    return dict(plain({**shared, "tasks": config.tasks, "planner": config.planner, "config": config.to_dict()}))


def _row(experiment: Experiment, episode: int, metrics: dict[str, Any], ms_per_step: float) -> Row:
    shared = identity(experiment)
    config = shared.pop("config")
    numbers = {"episode": episode, "seed": experiment.seed + episode, **metrics, "ms_per_step": ms_per_step}
    return dict(plain({**shared, **numbers, "config": config, "version": __version__}))


def centres(pose: NDArray[np.float32], config: EnvConfig) -> NDArray[np.float32]:
    """Return float32[..., N, 2], the centres [m] of all robots' bodies, front axles at pose float32[..., N, 3]."""
    back = np.array([robot.length / 2 - robot.front_overhang for robot in config.robots], np.float32)[:, None]
    ahead: NDArray[np.float32] = np.stack([np.cos(pose[..., 2]), np.sin(pose[..., 2])], axis=-1)
    return np.asarray(pose[..., :2] - back * ahead)


def pair_centres(centre: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return float32[P, 2], the middles of the pairs that robots at float32[K, 2], all hit in one step, make.

    A contact hits both of its robots in the same step, so each robot's partner is the nearest one of them.
    """
    if len(centre) < 2:
        return np.empty((0, 2), dtype=np.float32)
    distance = np.hypot(*(centre[:, None] - centre[None]).transpose(2, 0, 1))
    np.fill_diagonal(distance, np.inf)
    pairs = {(min(i, j), max(i, j)) for i, j in enumerate(distance.argmin(axis=1).tolist())}
    return np.stack([(centre[i] + centre[j]) / 2 for i, j in sorted(pairs)])
