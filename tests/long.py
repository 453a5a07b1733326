"""Drive one world with everything on for a million decisions, twice: the same digest, and nothing that grows.

    python -m tests.long --decisions 1000000 --keep results/long      # what `make long` does

Each time is a process of its own, which keeps its world at every tenth in KEEP and goes on from there. A robot that
stands for --patience, or is on the way to one goal for ENDLESS, is recorded: a page of the last ten to twenty minutes,
and beside it the world before, pickled, which `driven_on` drives to the same end.
"""

from __future__ import annotations

import gc
import hashlib
import multiprocessing
import os
import pickle
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import numpy as np  # noqa: E402
import tyro  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from train.books import simulator_of  # noqa: E402
from train.evaluation.rollout import config_of, make_actor  # noqa: E402
from train.learning.progress import LINE_SECONDS  # noqa: E402
from train.reporting.report import (  # noqa: E402
    Table,
    make_progress,
    tell,
)
from warehouse_env.config import EnvConfig  # noqa: E402
from warehouse_env.files import complete_file  # noqa: E402
from warehouse_env.maps.grid_map import GridMap  # noqa: E402
from warehouse_env.render.replay import replay_of  # noqa: E402
from warehouse_env.render.replay_page import write_replay_page  # noqa: E402
from warehouse_env.simulation.simulator import Simulator  # noqa: E402
from warehouse_env.traffic_spec import UncertaintySpec  # noqa: E402

POLICY, TIMES, PARTS = "threaded_ppo", 2, 10
PATIENCE, ENDLESS = 600.0, 1800.0  # [s] of standing, of one goal
PERIOD = 6000  # decisions between two copies of the world, of which the last two are kept


class Part(NamedTuple):
    """What was measured over a tenth of all decisions, or at its end."""

    decisions: int
    digest: str
    rss: float  # [MB]
    objects: int
    files: int
    us: float  # of processor time, for a decision of one robot
    goals: int  # reached so far
    stood: float  # [s] the longest that anyone has stood so far
    without: float  # [s] the longest that anyone has been on the way to one goal so far


def config(robots: int, people: int, decisions: int) -> EnvConfig:
    """Return a world with everything on."""
    base = EnvConfig(
        num_agents=robots,
        people=people,
        uncertainty=UncertaintySpec(loss=0.05, burst=1.0),
        max_steps=decisions,
        layout="paper46",
    )
    return config_of(POLICY, base, {"traffic": "assist"})


class Drive:
    """One world under way; it can be pickled, and goes on to the bit."""

    def __init__(self, env: EnvConfig, seed: int, patience: float = PATIENCE) -> None:
        self.simulator, self.rng = simulator_of(env, 1), np.random.default_rng([seed, 1])
        self.simulator.reset([seed])
        self.digest, self.done, self.parts = b"", 0, list[Part]()
        self._patience, self._late = patience, np.zeros(env.num_agents, dtype=np.bool_)

    def step(self, act: Any) -> list[int]:
        """Drive one decision; return the robots that have just run out of patience."""
        simulator = self.simulator
        simulator.step(act(simulator.observation, self.rng))
        self.done += 1
        state = (self.digest, simulator.robots, simulator.people.persons, simulator.reward)
        self.digest = hashlib.blake2b(b"".join(bytes(part) for part in state)).digest()
        robots = simulator.robots[0]
        late = (robots["clocks"]["standing_time"] > self._patience) | (
            robots["task"]["age"] > ENDLESS / simulator.config.time_step
        )
        new: list[int] = np.flatnonzero(late & ~self._late).tolist() if late.any() else []
        self._late = late
        return new

    def measure(self, decisions: int, seconds: float) -> None:
        """Add what there is to tell of the last decisions, which took some seconds."""
        gc.collect()
        figures = self.simulator.episode_metrics()
        self.parts.append(Part(
            self.done, self.digest.hex()[:16], _rss(), len(gc.get_objects()), len(os.listdir("/proc/self/fd")),
            1e6 * seconds / decisions / self.simulator.num_agents, round(figures["goals"]),
            figures["longest_standing_s"], figures["longest_without_goal_s"],
        ))  # fmt: skip


def _rss() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class Excerpt:
    """The last decisions of a drive, to be looked at as an Episode is: driven again from a pickled Drive."""

    def __init__(self, before: bytes, decisions: int) -> None:
        self._before, self._decisions = before, decisions
        drive: Drive = pickle.loads(before)
        self.config: EnvConfig = drive.simulator.config
        self.grid: GridMap = drive.simulator.grid
        self.seeds = (0,)
        self.pose: NDArray[np.float32] = np.stack([simulator.state.pose.copy() for simulator in self.replay()])

    def replay(self) -> Iterator[Simulator]:
        """Yield the simulator before, and after every decision."""
        yield from (drive.simulator for drive in driven_on(self._before, self._decisions))


def driven_on(before: bytes, decisions: int) -> Iterator[Drive]:
    """Yield a pickled Drive, and it again after each of some decisions."""
    drive: Drive = pickle.loads(before)
    act = make_actor(POLICY, drive.simulator.config)
    yield drive
    for _ in range(decisions):
        drive.step(act)
        yield drive


def record(before: bytes, decisions: int, robot: int, path: Path) -> None:
    """Keep the last decisions as a page that begins with a robot, and the world before them."""
    with complete_file(path.with_suffix(".pickle")) as part:
        part.write_bytes(before)
    replay = replay_of(Excerpt(before, decisions), path.stem)
    write_replay_page(path.with_suffix(".html"), [replay], path.stem, robot)


def drive(env: EnvConfig, seed: int, path: Path, title: str, patience: float = PATIENCE) -> None:
    """Drive all decisions, or go on with them, and keep what came of it in a file."""
    drive: Drive = pickle.loads(path.read_bytes()) if path.exists() else Drive(env, seed, patience)
    act, copies = make_actor(POLICY, env), [(drive.done, pickle.dumps(drive))]
    each, told = max(1, env.max_steps // PARTS), time.monotonic()
    begin, since = time.process_time(), drive.done
    with make_progress() as progress:
        bar = progress.add_task(title, total=env.max_steps, completed=drive.done)
        while drive.done < env.max_steps:
            late = drive.step(act)
            if late:
                record(copies[0][1], drive.done - copies[0][0], late[0], path.parent / f"{path.stem}-{drive.done}")
            if drive.done % PERIOD == 0:
                copies = [*copies[-1:], (drive.done, pickle.dumps(drive))]
            if drive.done % each == 0:
                drive.measure(drive.done - since, time.process_time() - begin)
                with complete_file(path) as part:
                    part.write_bytes(pickle.dumps(drive))
                begin, since = time.process_time(), drive.done
            if drive.done % 100 == 0:
                progress.update(bar, completed=drive.done)
                if progress.disable and time.monotonic() - told > LINE_SECONDS:
                    tell(f"{title}: {drive.done:,} of {env.max_steps:,} decisions")
                    told = time.monotonic()


def part_table(parts: list[Part]) -> Table:
    """Return a line for each tenth."""
    header = (
        "decisions", "digest", "memory MB", "objects", "files", "us a robot", "goals", "stood s", "without a goal s"
    )  # fmt: skip
    cells = [
        (f"{p.decisions:,}", p.digest, f"{p.rss:.1f}", f"{p.objects:,}", str(p.files), f"{p.us:.1f}", str(p.goals),
         f"{p.stood:.1f}", f"{p.without:.1f}")
        for p in parts
    ]  # fmt: skip
    return Table("One world with everything on", header, tuple(cells))


def main(
    decisions: int, keep: Path, robots: int = 32, people: int = 5, seed: int = 0, patience: float = PATIENCE
) -> None:
    """Drive one world twice, and say whether both came to the same and what grew.

    Args:
        decisions: of each robot.
        keep: folder of the worlds under way and of recordings; the same call with the same folder goes on.
        robots: in the world.
        people: among them.
        seed: of the world.
        patience: time for which a robot may stand until it is recorded [s].
    """
    env, drives = config(robots, people, decisions), list[Drive]()
    keep.mkdir(parents=True, exist_ok=True)
    for time_ in range(TIMES):
        path = keep / f"{robots}-{people}-{seed}-{decisions}-{time_}.pickle"
        given = env, seed, path, f"time {time_ + 1}", patience
        process = multiprocessing.get_context("spawn").Process(target=drive, args=given)
        process.start()
        process.join()
        if process.exitcode:
            sys.exit(f"time {time_ + 1} ended with {process.exitcode}; what it has done is kept in {path}")
        drives.append(pickle.loads(path.read_bytes()))
        part_table(drives[-1].parts).print()
    recordings = sorted(keep.glob("*.html"))
    print(f"{len(recordings) or 'nobody'} recorded" + "".join(f"\n{page}" for page in recordings))
    same = len({drive.digest for drive in drives}) == 1
    print("both came to the same digest" if same else "they came to other digests")
    if recordings or not same:
        sys.exit(1)


if __name__ == "__main__":
    tyro.cli(main)
