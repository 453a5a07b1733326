"""Drive one world with all features for a million decisions, twice: equal digests, no growth.

    python -m tests.long --decisions 1000000 --keep results/long      # what `make long` does

Each drive is its own process. It saves its world in KEEP after every tenth, and a second call resumes from there.
"""

from __future__ import annotations

import gc
import hashlib
import multiprocessing
import os
import pickle
import sys
import time
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import numpy as np  # noqa: E402
import tyro  # noqa: E402

from agents import Actor, make_policy  # noqa: E402
from train.books import simulator_of  # noqa: E402
from train.evaluation.rollout import config_of  # noqa: E402
from train.reporting.report import Table, make_progress  # noqa: E402
from warehouse_env.config import EnvConfig  # noqa: E402
from warehouse_env.files import complete_file  # noqa: E402
from warehouse_env.traffic_spec import UncertaintySpec  # noqa: E402

POLICY, TIMES, PARTS = "shielded", 2, 10
PATIENCE, ENDLESS = 600.0, 1800.0  # [s] limits of standing and of pursuing one goal
HEADER = ("decisions", "digest", "memory MB", "objects", "files", "us a robot", "goals", "stood s", "without a goal s")


def config(robots: int, people: int, decisions: int) -> EnvConfig:
    """Return a configuration with all features."""
    lossy = UncertaintySpec(loss=0.05, burst=1.0)
    base = EnvConfig(num_agents=robots, people=people, uncertainty=lossy, max_steps=decisions, layout="paper46")
    return config_of(POLICY, base, {"traffic": "assist"})


class Drive:
    """One running world; it can be pickled and resumes to the bit."""

    def __init__(self, env: EnvConfig, seed: int) -> None:
        self.simulator, self.rng = simulator_of(env, 1), np.random.default_rng([seed, 1])
        self.simulator.reset([seed])
        self.digest, self.done, self.parts = b"", 0, list[tuple[str, ...]]()

    def step(self, act: Any) -> None:
        """Make one decision."""
        simulator = self.simulator
        simulator.step(act(simulator.observation, self.rng))
        self.done += 1
        state = (self.digest, simulator.robots, simulator.people.persons, simulator.reward)
        self.digest = hashlib.blake2b(b"".join(bytes(part) for part in state)).digest()

    def measure(self, decisions: int, seconds: float) -> None:
        """Add a row about the last decisions, which took `seconds` of processor time."""
        gc.collect()
        figures, pages = self.simulator.episode_metrics(), int(Path("/proc/self/statm").read_text().split()[1])
        self.parts.append((
            f"{self.done:,}", self.digest.hex()[:16], f"{pages * os.sysconf('SC_PAGE_SIZE') / 1e6:.1f}",
            f"{len(gc.get_objects()):,}", str(len(os.listdir("/proc/self/fd"))),
            f"{1e6 * seconds / decisions / self.simulator.num_agents:.1f}", f"{figures['goals']:.0f}",
            f"{figures['longest_standing_s']:.1f}", f"{figures['longest_without_goal_s']:.1f}",
        ))  # fmt: skip

    @property
    def jammed(self) -> bool:
        """Return whether a robot stood or reached no goal for too long."""
        figures = self.simulator.episode_metrics()
        return figures["longest_standing_s"] > PATIENCE or figures["longest_without_goal_s"] > ENDLESS


def drive(env: EnvConfig, seed: int, path: Path, title: str) -> None:
    """Make the remaining decisions; save the world and its rows in a file."""
    drive: Drive = pickle.loads(path.read_bytes()) if path.exists() else Drive(env, seed)
    act, each = Actor(make_policy(POLICY, env), env), max(1, env.max_steps // PARTS)
    begin, since = time.process_time(), drive.done
    with make_progress() as progress:
        bar = progress.add_task(title, total=env.max_steps, completed=drive.done)
        while drive.done < env.max_steps:
            drive.step(act)
            if drive.done % each == 0:
                drive.measure(drive.done - since, time.process_time() - begin)
                with complete_file(path) as part:
                    part.write_bytes(pickle.dumps(drive))
                begin, since = time.process_time(), drive.done
            if drive.done % 100 == 0:
                progress.update(bar, completed=drive.done)


def main(decisions: int, keep: Path, robots: int = 32, people: int = 5, seed: int = 0) -> None:
    """Drive one world twice; print whether both digests agree and what grew.

    Args:
        decisions: decisions of each robot.
        keep: folder of the running worlds; the same call with the same folder resumes.
        robots: number of robots.
        people: number of people.
        seed: seed of the world.
    """
    env, drives = config(robots, people, decisions), list[Drive]()
    keep.mkdir(parents=True, exist_ok=True)
    for time_ in range(TIMES):
        path = keep / f"{robots}-{people}-{seed}-{decisions}-{time_}.pickle"
        given = env, seed, path, f"time {time_ + 1}"
        process = multiprocessing.get_context("spawn").Process(target=drive, args=given)
        process.start()
        process.join()
        if process.exitcode:
            sys.exit(f"time {time_ + 1} ended with {process.exitcode}; what it has done is kept in {path}")
        drives.append(pickle.loads(path.read_bytes()))
        Table("One world with everything on", HEADER, tuple(drives[-1].parts)).print()
    same = len({drive.digest for drive in drives}) == 1
    print("both came to the same digest" if same else "they came to other digests")
    if drives[0].jammed:
        print(f"a robot stood for more than {PATIENCE:g} s, or pursued one goal for more than {ENDLESS:g} s")
    sys.exit(not same or drives[0].jammed)


if __name__ == "__main__":
    tyro.cli(main)
