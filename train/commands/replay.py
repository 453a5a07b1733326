"""`warehouse record` and `replay`: save an episode to a file, and show one or two as a page or a video."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from train.commands.evaluate import Working
from train.commands.layouts import BY_MAP
from train.evaluation.recorded import record, shares_of
from train.evaluation.rollout import make_experiment
from train.fleet.driven import load_episode
from train.job_files import OwnSensors
from train.reporting.report import make_progress, require_video
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.plugins import split
from warehouse_env.render.pages import write_replay_page
from warehouse_env.render.replay import Replay, replay_of
from warehouse_env.simulation.record.recording import Episode

if TYPE_CHECKING:
    from warehouse_env.render.frame import Scene


@dataclass(frozen=True)
class Record(Working):
    """Drive a policy through one episode and save it to a file, for `warehouse replay`."""

    policy: str = "ppo"
    """Policy to drive, named as for `warehouse evaluate`."""
    layout: Annotated[str, BY_MAP] = "paper46"
    """Floor to drive on: a name of `warehouse layouts`, a file NAME.map or NAME.yaml, or your own, FILE.py:FUNCTION."""
    robots: int = 16
    """Number of robots."""
    seconds: float = 120.0
    """Simulated time of the episode [s]."""
    tasks: str = "lifelong"
    """lifelong: a new goal after every arrival; one_shot: one goal each, then parked; or your own, FILE.py:CLASS."""
    out: Path = Path("results/episode.npz")
    """File for the episode."""

    def run(self) -> None:
        """Drive, write the file, and print the command that shows it."""
        base = EnvConfig(self.layout, self.robots, self.planner, self.tasks)
        experiment = make_experiment(self.policy, base, 1, self.seconds, self.seed, self.chosen_for(self.robots))
        with make_progress() as progress:
            bar = progress.add_task(experiment.title, total=experiment.config.max_steps)
            episode = record(experiment, lambda: progress.advance(bar))
        episode.save(self.out)
        kinds = ("policy", "planner", "tasks")
        typed = [*((kind, getattr(self, kind)) for kind in kinds), *(("sensor", one) for one in self.sensor)]
        own = [f"--{kind}={name}" for kind, name in typed if split(name)]
        page = str(self.out.with_suffix(".html"))
        show = shlex.join(["warehouse", "replay", str(self.out), "--html", page, *own])
        print(f"wrote the episode to {self.out}; to see it: {show}")


Shown = tuple[Episode, int, str]
"""An episode, the world of it that is shown, and its name."""

FLUENT = 25.0  # frames a second that a video is to come near
PIXELS = 736  # of the longest side of a floor in a video


@dataclass(frozen=True)
class ReplayCommand(OwnSensors):
    """Show a recorded episode, or two side by side and in step: --html or --video."""

    episodes: tyro.conf.Positional[tuple[Path, ...]] = ()
    """One or two files of `warehouse record`, or of `warehouse fleet --listen`."""
    html: Path | None = None
    """Write one HTML file, which any browser shows offline."""
    video: Path | None = None
    """Write a video, .mp4 or .gif."""
    speed: float = 4.0
    """Simulated seconds per second of the video."""
    seed: int | None = None
    """Seed of the world to show (default: the first world)."""
    planner: tuple[str, ...] = ()
    """Your own planners that the episodes were recorded with, under the same names: files alone never run code."""
    tasks: tuple[str, ...] = ()
    """Your own samplers of starts and goals that the episodes were recorded with."""
    policy: tuple[str, ...] = ()
    """Your own policies that drove the episodes, under the same names, to show their preferences."""
    ranges: ClassVar = {"speed": (0.01, 1000.0)}

    def run(self) -> None:
        """Load the episodes, show them, and print what was written."""
        if (self.html is None) == (self.video is None):
            raise ConfigError("choose one of --html FILE and --video FILE")
        if not 1 <= len(self.episodes) <= 2:
            raise ConfigError(f"name one episode file, or two to see side by side, not {len(self.episodes)}")
        episodes = [load_episode(path) for path in self.episodes]
        worlds = [world_of(path, one.seeds, self.seed) for path, one in zip(self.episodes, episodes, strict=True)]
        shown = list(zip(episodes, worlds, names_of(self.episodes, episodes), strict=True))
        if self.html is not None:
            self._write_page(self.html, shown)
        elif self.video is not None:
            self._write_video(self.video, shown)

    def _write_page(self, path: Path, shown: Sequence[Shown]) -> None:
        replays: list[Replay] = []
        with make_progress() as progress:
            bar = progress.add_task("replay", total=sum(len(one.actions) + 1 for one, _, _ in shown))
            for episode, world, name in shown:
                try:
                    shares = shares_of(episode.policy, episode.config, episode.made_of)
                except WarehouseError as error:
                    progress.console.print(f"without the policy's preferences: {error}", markup=False)
                    shares = None
                replays.append(replay_of(episode, name, shares, world, lambda _: progress.advance(bar)))
        write_replay_page(path, replays, " and ".join(name for _, _, name in shown))
        print(f"wrote the replay to {path} ({path.stat().st_size / 1e6:.1f} MB); any browser opens it")

    def _write_video(self, path: Path, shown: Sequence[Shown]) -> None:
        from train.evaluation.films import side_by_side
        from warehouse_env.render.floor import scale_for
        from warehouse_env.render.video import VideoWriter

        require_video()
        episodes = [episode for episode, _, _ in shown]
        every, fps = pace(episodes, self.speed)
        scale = min(scale_for(episode.grid, PIXELS, most=64.0) for episode in episodes)
        with VideoWriter(path, fps) as video, make_progress() as progress:
            bar = progress.add_task("video", total=1 + int(max(map(seconds_of, episodes)) / every + 1e-6))
            for frame in side_by_side([_film(*one, every) for one in shown], scale):
                video.add(frame)
                progress.advance(bar)
        print(f"wrote the video to {path}: {video.frames / fps:.0f} s at {self.speed:g} times the speed")


def world_of(path: Path, seeds: tuple[int, ...], seed: int | None) -> int:
    """Return the number of the world of a seed in an episode's file, the first one for None; ConfigError if missing."""
    if seed is None:
        return 0
    if seed not in seeds:
        raise ConfigError(f"{path} has no world of seed {seed}; its seeds are {', '.join(map(str, seeds[:8]))}")
    return seeds.index(seed)


def names_of(paths: Sequence[Path], episodes: Sequence[Episode]) -> list[str]:
    """Return what episodes are called: by their policies if these differ, otherwise by their files."""
    policies = [Path(episode.policy).name for episode in episodes]
    differ = all(policies) and len(set(policies)) == len(policies)
    return policies if differ else [path.stem for path in paths]


def seconds_of(episode: Episode) -> float:
    """Return the simulated time of an episode [s]."""
    return len(episode.actions) * _step(episode)


def _step(episode: Episode) -> float:
    return episode.config.time_step * episode.config.action_repeat


def pace(episodes: Sequence[Episode], speed: float) -> tuple[float, float]:
    """Return the simulated time between two frames [s], a multiple of the longest step, and the frame rate [1/s]."""
    step = max(map(_step, episodes))
    every = step * max(1, round(speed / FLUENT / step))
    return every, speed / every


def _film(episode: Episode, world: int, name: str, every: float) -> Iterator[Scene]:
    """Yield a scene at every multiple of `every` [s] of an episode, of the last step before."""
    from warehouse_env.render.frame import scene_of

    shown = 0
    for steps, simulator in enumerate(episode.replay()):
        while shown * every < (steps + 1) * _step(episode) - 1e-6 and shown * every <= seconds_of(episode) + 1e-6:
            scene = scene_of(simulator, world)
            yield scene._replace(text=f"{name}   {scene.text}")
            shown += 1
