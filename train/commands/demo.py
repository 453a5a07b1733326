"""`warehouse demo`: the main job in half a minute. The shipped policies against three rules: table, pictures, video.

The first run compiles the kernels before, which takes longer, unless set-up has done so."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from train.commands.evaluate import Evaluate
from train.evaluation.kernels import compile_all, is_compiled
from train.evaluation.rollout import make_experiment, run
from train.learning.config import HELD_OUT_SEED
from train.reporting.report import make_progress, require_video
from train.reporting.rows import read_rows
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.simulation.simulator import Simulator

if TYPE_CHECKING:
    from warehouse_env.render.frame import Scene

_FRAMES_PER_SECOND = 10.0
_BETWEEN = 2 / _FRAMES_PER_SECOND  # [s] from one frame to the next: twice as fast as in life
_SIDE = 560  # [px], longest side of one of the two floors in the video
_STANDING = 10.0  # [s] within a metre of one place after which a robot is counted as standing


@dataclass(frozen=True)
class Demo(Checked):
    """Compare the shipped policies with three rules on one floor: path following, stopping for others, right of way."""

    policy: tuple[str, ...] = ("follow", "brake", "greedy", "reinforce", "ppo", "threaded_ppo")
    """Policies to compare, named as for `warehouse evaluate`; the video shows the first and, of the others, the one
    with the most goals."""
    layout: str = "paper46"
    """Floor to drive on, named as for `warehouse evaluate`."""
    robots: int = 16
    """Number of robots."""
    episodes: int = 3
    """Episodes of each policy."""
    seconds: float = 600.0
    """Simulated time of an episode [s]."""
    video_robots: int = 64
    """Number of robots in the video, which shows two policies side by side, each with the same tasks."""
    video_from: float = 420.0
    """Simulated time after which the video begins, when jams have built up [s]."""
    video_seconds: float = 60.0
    """Simulated time that the video shows, at twice the speed [s]; 0 makes none."""
    planner: str = EnvConfig.planner
    """Planner of the routes."""
    processes: int = field(default_factory=lambda: min(os.cpu_count() or 1, 4))
    """Policies to drive at a time, each in a process of its own."""
    seed: int = HELD_OUT_SEED
    """Seed of the first episode; no training uses seeds from the default on."""
    json: Path | None = None
    """File for the rows, one an episode, as JSON lines (OUT/rows.jsonl if left out)."""
    out: Path = Path("results/demo")
    """Folder for the rows, the table, the pictures and the video."""
    overwrite: bool = False
    """Replace the rows that another folder than the default one holds already."""

    def run(self) -> None:
        """Evaluate, then film."""
        if not 0 <= self.video_seconds <= 3600:
            raise ConfigError(f"--video-seconds {self.video_seconds} must lie between 0 and 3600")
        if not 0 <= self.video_from <= 3600:
            raise ConfigError(f"--video-from {self.video_from} must lie between 0 and 3600")
        if self.video_seconds:
            require_video()
        begin = time.perf_counter()
        if not is_compiled():  # else each policy's process would compile the same
            compile_all(self.processes)
        Evaluate(
            policy=self.policy, layout=(self.layout,), robots=(self.robots,), episodes=self.episodes,
            seconds=self.seconds, planner=self.planner, seed=self.seed, json=self.json, out=self.out,
            processes=self.processes, overwrite=self.overwrite or (self.json, self.out) == (None, Demo.out),
        ).run()  # fmt: skip
        video = [f"the video to {self._film(self.out / 'video.mp4')}, "] if self.video_seconds else []
        print(f"wrote {''.join(video)}all else to {self.out}, in {time.perf_counter() - begin:.0f} s")

    def _film(self, path: Path) -> Path:
        """Write the first policy and the best of the others side by side: the same floor, seed and robots."""
        from warehouse_env.render.floor import scale_for
        from warehouse_env.render.frame import draw
        from warehouse_env.render.video import VideoWriter

        base = EnvConfig(layout=self.layout, num_agents=self.video_robots, planner=self.planner)
        reels = []
        for policy in self._filmed():
            reel = Reel(policy, self.video_from)
            run(make_experiment(policy, base, 1, self.video_from + self.video_seconds, self.seed), [reel])
            reels.append(reel.scenes)
        scale = scale_for(reels[0][0].grid, _SIDE)
        with make_progress() as progress, VideoWriter(path, _FRAMES_PER_SECOND) as video:
            bar = progress.add_task("video", total=min(map(len, reels)))
            for scenes in zip(*reels, strict=False):
                video.add(np.concatenate([draw(scene, scale) for scene in scenes], axis=1))
                progress.advance(bar)
        return path

    def _filmed(self) -> list[str]:
        """Return the first policy and, of the others, the one with the most goals in the rows just written."""
        rows = read_rows(self.json or self.out / "rows.jsonl")
        goals = {name: sum(row["goals"] for row in rows if row["policy"] == name) for name in self.policy}
        first, *others = self.policy
        return [first, max(others, key=goals.__getitem__)] if others else [first]


class Reel:
    """A watcher that keeps a scene of the first world at even times from one on, captioned with counters."""

    def __init__(self, name: str, begin: float) -> None:
        """Keep scenes from `begin` [s]; `name` stands first in the captions."""
        self.scenes: list[Scene] = []
        self._name, self._begin = name, begin

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Keep the scene if its time has come."""
        from warehouse_env.render.frame import scene_of

        if simulator.seconds(0) < self._begin + len(self.scenes) * _BETWEEN - simulator.config.time_step / 2:
            return
        metrics = simulator.episode_metrics(0)
        contacts = round(metrics["collisions_robot"] + metrics["collisions_shelf"])
        standing = int((simulator.robots[0]["clocks"]["standing_time"] > _STANDING).sum())
        text = f"{self._name}   {round(metrics['goals'])} goals   {standing} standing   {contacts} collisions"
        self.scenes.append(scene_of(simulator)._replace(text=text))
