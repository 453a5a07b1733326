"""`warehouse demo`: the shipped policies against three rules: table, pictures, video."""

import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from train.commands.evaluate import Evaluate
from train.evaluation.kernels import compile_missing
from train.learning.config import HELD_OUT_SEED
from train.reporting.report import require_video, tell
from train.reporting.rows import read_rows
from warehouse_env.checked import Checked

_SIDE = 560  # [px], longest side of one of the two floors in the video


@dataclass(frozen=True)
class Demo(Checked):
    """Compare the shipped policies with three rules on one floor: path following, stopping for others, right of way."""

    policy: tuple[str, ...] = ("follow", "brake", "greedy", "reinforce", "ppo", "careful", "shielded")
    """Policies to compare, named as for `warehouse evaluate`; the video shows the first one and the best of the others
    (most goals)."""
    layout: str = "paper46"
    """Floor to drive on, named as for `warehouse evaluate`."""
    robots: int = 16
    """Number of robots; the video shows four times as many."""
    episodes: int = 3
    """Episodes of each policy."""
    seconds: float = 600.0
    """Simulated time of an episode [s]."""
    video_seconds: float = 60.0
    """Simulated time in the video of two policies with the same tasks, shown at twice the speed [s]; 0: no video."""
    processes: int = field(default_factory=lambda: min(os.cpu_count() or 1, 4))
    """Policies to drive at a time, each in a process of its own."""
    out: Path = Path("results/demo")
    """Folder for the rows, the table, the pictures and the video."""
    overwrite: bool = False
    """Replace existing rows in a folder other than the default one."""
    ranges: ClassVar = {"video_seconds": (0.0, 3600.0)}

    def run(self) -> None:
        """Evaluate, then film."""
        if self.video_seconds:
            require_video()
        begin = time.perf_counter()
        compile_missing(self.processes)  # else every process would compile the same kernels
        Evaluate(
            policy=self.policy, layout=(self.layout,), robots=(self.robots,), episodes=self.episodes,
            seconds=self.seconds, out=self.out, processes=self.processes,
            overwrite=self.overwrite or self.out == Demo.out,
        ).run()  # fmt: skip
        if self.video_seconds:
            from train.evaluation.films import film

            tell("films the first policy and the best of the others")
            film(
                self.out / "video.mp4", *self._filmed(), begin=0.7 * self.seconds, seconds=self.video_seconds,
                pixels=_SIDE, seed=HELD_OUT_SEED, layout=self.layout, num_agents=4 * self.robots,
            )  # fmt: skip
        video = f"the video to {self.out / 'video.mp4'}, " * (self.video_seconds > 0)
        print(f"wrote {video}all else to {self.out}, in {time.perf_counter() - begin:.0f} s")

    def _filmed(self) -> list[str]:
        """Return the first policy and, of the others, the one with the most goals in the rows just written."""
        rows = read_rows(self.out / "rows.jsonl")
        goals = {name: sum(row["goals"] for row in rows if row["policy"] == name) for name in self.policy}
        first, *others = self.policy
        return [first, max(others, key=goals.__getitem__)] if others else [first]
