"""Recorded episodes, with the policy's preferences at every moment, and the worst episodes of an evaluation."""

import dataclasses
from collections.abc import Callable, Sequence
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import Actor, LearnedPolicy, make_policy
from agents.policy import Preferring
from train.books import simulator_of
from train.evaluation.disturbances import DISTURBANCES
from train.evaluation.pictures import file_name
from train.evaluation.rollout import Experiment, identity, play_out
from train.job_files import versions
from train.reporting.page import Link
from train.reporting.report import grouped, number
from train.reporting.rows import Row
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WeightsError, counted
from warehouse_env.render.pages import write_replay_page
from warehouse_env.render.replay import Shares, replay_of
from warehouse_env.simulation.record.recording import Episode, Recorder


def record(experiment: Experiment, moved: Callable[[], object] = lambda: None) -> Episode:
    """Play the first episode of an experiment exactly as `run` does, and return it; moved: called after each step.

    Raises ConfigError for breakdowns, which an episode file cannot hold.
    """
    name = experiment.disturbance
    if name is not None and DISTURBANCES[name].breakdown is not None:
        raise ConfigError(f"under the disturbance {name!r} robots break down, and no episode can be recorded")
    recorder = Recorder(simulator_of(experiment.config, 1), (experiment.seeds[0],), experiment.policy)
    one = dataclasses.replace(experiment, episodes=experiment.episodes[:1])

    def step(actions: NDArray[Any]) -> None:
        recorder.step(actions)
        moved()

    play_out(one, recorder.simulator, step=step)
    return dataclasses.replace(recorder.episode, made_of=_made_of(experiment.policy))


def _made_of(policy: str) -> str:
    return versions(policy).get(policy, "")


def shares_of(policy: str, config: EnvConfig, made_of: str = "") -> Shares | None:
    """Return a policy's preferences over the actions, for one `replay_of`; None if it has none, or no name.

    These are the probabilities of a learned policy, or the order of a rule: 1 for its first choice, 0 for its last.
    made_of: see Episode. Raises ConfigError or WeightsError for a policy that cannot be made or is not the same.
    """
    if not policy or config.action_type != "discrete":
        return None
    made = make_policy(policy, config)
    if made_of not in ("", _made_of(policy)):
        raise WeightsError(f"{policy} is not the policy that was recorded, but another of that name")
    if not isinstance(made, Preferring):
        return None
    actor = Actor(made, config)

    def shares(observation: NDArray[np.float32]) -> NDArray[np.float64]:
        liked = actor.preferences(observation).astype(np.float64)
        liked -= liked.max(axis=-1, keepdims=True)
        if isinstance(made, LearnedPolicy):
            likely = np.exp(liked)
            return np.asarray(likely / likely.sum(axis=-1, keepdims=True))
        return np.asarray(1 - liked / liked.min(axis=-1, keepdims=True).clip(max=-1e-9))

    return shares


FOLDER = "replays"  # beside the page


def worst_episodes(rows: Sequence[Row], count: int) -> list[Row]:
    """Return the worst episodes: the worst of each policy, then the second of each, and so on; worst first in a turn.

    Collisions per km count first, then robots stuck at the end, then the longest standing.
    """
    turns = [sorted(group, key=_badness, reverse=True) for group in grouped(rows, ("policy",)).values()]
    ranked = (row for turn in zip_longest(*turns) for row in sorted(filter(None, turn), key=_badness, reverse=True))
    return list(islice(ranked, count))


def _badness(row: Row) -> tuple[float, float, float]:
    return row["collisions_per_km"] or 0.0, row["stuck"], row["longest_standing_s"]


def why(row: Row) -> str:
    """Return why an episode is among the worst."""
    hits = round(row["collisions_robot"] + row["collisions_shelf"] + row.get("collisions_person", 0))
    stuck = round(row["stuck"] * row["robots"])
    return (
        f"{hits or 'no'} collision{'s' * (hits != 1)}, {stuck or 'no'} robot{'s' * (stuck != 1)} stuck at the end, "
        f"{number(row['longest_standing_s'], 2)} s the longest standing"
        + (f": {told}" if (told := row.get("longest_standing_why")) else "")
    )


def write_replays(
    worst: Sequence[Row], experiments: Sequence[Experiment], folder: Path, tick: Callable[[], None]
) -> list[Link]:
    """Play the episodes again and write each as an episode file and a replay page; return links from the folder."""
    links = []
    for row in worst:
        known = (one for one in experiments if row["episode"] in one.episodes)
        made_by = next(one for one in known if all(row.get(k) == value for k, value in identity(one).items()))
        episode = record(dataclasses.replace(made_by, episodes=(row["episode"],)))
        policy = Path(row["policy"]).name
        title = f"{policy}, {counted(row['robots'], 'robot')} on {Path(row['layout']).stem}, seed {row['seed']}"
        name = "_".join(map(file_name, (row["layout"], str(row["robots"]), row["policy"], str(row["seed"]))))
        episode.save(folder / FOLDER / f"{name}.npz")
        page = folder / FOLDER / f"{name}.html"
        write_replay_page(page, [replay_of(episode, policy, shares_of(episode.policy, episode.config))], title)
        links.append(Link(page.relative_to(folder).as_posix(), title, why(row)))
        tick()
    return links
