"""`warehouse audit`: check recorded or driven episodes for overlaps at every instant, as jobs; a table, sentences."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from train.commands.evaluate import Episodes
from train.evaluation.audit.instants import OVERLAPS
from train.evaluation.audit.watcher import Audit
from train.evaluation.disturbances import DISTURBANCES
from train.evaluation.episodes import TICK, EpisodesJob
from train.evaluation.jobs import Job, Result, Tick
from train.evaluation.rollout import run
from train.fleet.driven import load_simulated
from train.reporting.report import Table, grouped, number
from train.reporting.rows import Row, short_names
from warehouse_env import __version__
from warehouse_env.errors import ConfigError, check_known, counted
from warehouse_env.files import whereabouts
from warehouse_env.simulation.record.recording import Episode

_SHOWN = 20  # faults in words; the rows have them all


@dataclass(frozen=True)
class AuditCommand(Episodes):
    """Check robots' motion at every instant, independently of the engine: overlaps, limits, jumps; exit code 1 if any.

    Checks episode files (`warehouse record`), which are driven again, or with --policy episodes as they are driven.
    """

    files: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Files of `warehouse record`; none with --policy."""
    policy: tuple[str, ...] = ()
    """Policies to drive and audit, named as for `warehouse evaluate`."""
    disturbance: tuple[str, ...] = ()
    """With --policy: disturbances, named as for `warehouse robust` (default: none)."""
    out: Path = Path("results/audit")
    """Folder for the rows and the table."""

    def run(self) -> None:
        """Audit all, print the table and the faults, write the rows and the table; exit with 1 if there is a fault."""
        rows = self.tabulate(self._jobs(), audit_table, resumes=not self.files)
        faults = sum(map(faults_of, rows))
        for sentence in itertools.islice(sentences(rows), _SHOWN):
            print(sentence)
        more = f", the first {_SHOWN} above" if faults > _SHOWN else ""
        print(f"{faults or 'no'} fault{'s' * (faults != 1)}{more}; wrote the rows to {self.rows_path}")
        if faults:
            raise SystemExit(1)

    def _jobs(self) -> Sequence[Job]:
        if bool(self.files) == bool(self.policy):
            raise ConfigError("name episode files to audit, or policies to drive with --policy")
        if self.files and self.disturbance:
            raise ConfigError("--disturbance must be left out with episode files, which say what disturbed them")
        if self.files and self.resume:
            raise ConfigError("--resume must be left out with episode files")
        if self.files:
            episodes = [(path, load_simulated(path)) for path in self.files]
            configs = [episode.config for _, episode in episodes]
            jobs: list[Job] = [RecordedEpisode(path, len(episode.actions)) for path, episode in episodes]
        else:
            check_known("disturbance", self.disturbance, DISTURBANCES)
            experiments = [one for name in self.disturbance or (None,) for one in self.experiments(name)]
            configs = [one.config for one in experiments]
            jobs = [DrivenEpisodes(one) for one in experiments]
        for config in configs:  # raises before anything drives
            Audit(config)
        return jobs


CHECKS = 1  # version of the checks: rows of another version are not reused


@dataclass(frozen=True)
class DrivenEpisodes(EpisodesJob):
    """The episodes of an experiment, audited while they are driven; rows of an evaluation with the faults."""

    @property
    def identity(self) -> Row:
        """The fields that all rows share."""
        return {**super().identity, "checks": CHECKS}

    def run(self, tick: Tick) -> Result:
        """Drive and audit."""
        audit = Audit(self.experiment.config)
        rows = run(self.experiment, [self.ticking(tick), audit])
        shared = {"checks": CHECKS, "differs_at": None}
        return Result([row | shared | found for row, found in zip(rows, audit.rows(), strict=True)])


@dataclass(frozen=True)
class RecordedEpisode(Job):
    """A recorded episode of `steps` steps, one row per world."""

    path: Path
    steps: int

    titled = "{path}"

    @property
    def size(self) -> float:
        """Its steps."""
        return self.steps

    @property
    def files(self) -> tuple[str, ...]:
        """The episode."""
        return (str(self.path),)

    def run(self, tick: Tick) -> Result:
        """Play the episode again, audit it, and compare it with the recorded poses."""
        episode = Episode.load(whereabouts(str(self.path)))
        config, audit = episode.config, Audit(episode.config)
        differs: dict[int, int] = {}  # world: the first step whose poses are others
        for step, simulator in enumerate(episode.replay()):
            audit(simulator, step)
            same = simulator.state.pose.view(np.uint32) == episode.pose[step].astype(np.float32).view(np.uint32)
            for world in np.flatnonzero(~same.all(axis=(1, 2))).tolist():
                differs.setdefault(world, step)
            if step % TICK == 0:
                tick(step)
        shared = {
            "policy": episode.policy, "layout": episode.grid.name, "robots": config.num_agents, "tasks": config.tasks,
            "planner": config.planner, "episode": self.path,
        }  # fmt: skip
        return Result([
            {**shared, "seed": seed, "differs_at": differs.get(world), **found, "config": config.to_dict(),
             "checks": CHECKS, "version": __version__}
            for world, (seed, found) in enumerate(zip(episode.seeds, audit.rows(), strict=True))
        ])  # fmt: skip


_GROUP = ("layout", "robots", "policy")
_COUNTS = (*(f"overlaps_{kind}" for kind in OVERLAPS), "limits", "jumps")
_UNITS = {"speed": "m/s", "acceleration": "m/s^2", "steering": "rad", "steering rate": "rad/s"}
NOTE = (
    "Overlaps at any instant, of bodies with each other, with shelves or the rim, and with people; limits: speed, "
    "acceleration, steering or its rate beyond the robot's; jumps: no motion leads from one pose to the next; closest: "
    "two bodies at any instant (- over 500 mm); other poses: recordings that this version does not drive again to the "
    "bit."
)


def faults_of(row: Row) -> int:
    """Return the number of faults in an audit's row."""
    return len(row["faults"]) + (row["differs_at"] is not None)


def audit_table(rows: Sequence[Row]) -> Table:
    """Return the table: a line for each layout, number of robots and policy, and one of all."""
    short = short_names({str(row[name]) for row in rows for name in ("layout", "policy")})
    lines = []
    for (layout, robots, policy), group in grouped(rows, _GROUP).items():
        lines.append((short[str(layout)], str(robots), short[str(policy)], *_figures(group)))
    if len(lines) > 1:
        lines.append(("all", "", "", *_figures(rows)))
    header = (
        *_GROUP, "episodes", "robot-km", "with robots", "with shelves", "with people", "limits", "jumps",
        "deepest mm", "closest mm", "other poses",
    )  # fmt: skip
    return Table("Audit", header, tuple(lines), NOTE)


def _figures(rows: Sequence[Row]) -> tuple[str, ...]:
    counts = (str(sum(row[name] for row in rows)) for name in _COUNTS)
    closest = [row["closest_m"] for row in rows if row["closest_m"] is not None]
    return (
        str(len(rows)), number(sum(row["robot_km"] for row in rows), 4), *counts,
        number(1000 * max(row["deepest_m"] for row in rows)), number(1000 * min(closest)) if closest else "-",
        str(sum(row["differs_at"] is not None for row in rows)),
    )  # fmt: skip


def sentences(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a sentence for each fault."""
    for row in rows:
        where = f"{Path(row['policy']).name} on {row['layout']}, {counted(row['robots'], 'robot')}, seed {row['seed']}"
        if row["differs_at"] is not None:
            yield f"{where}: at step {row['differs_at']} {row['episode']} has other poses than this version drives"
        yield from (f"{where}: {_sentence(fault)}" for fault in row["faults"])


def _sentence(fault: Row) -> str:
    kind, size = fault["kind"], fault["size"]
    at = f"in step {fault['step']} at ({fault['x']:.2f}, {fault['y']:.2f}) m"
    if kind == "jump":
        return f"robot {fault['robot']} jumps by {number(1000 * size)} mm {at}"
    if kind in OVERLAPS:
        other = "a shelf" if kind == "shelf" else f"{kind} {fault['other']}"
        return f"robot {fault['robot']} overlaps {other} by {number(1000 * size)} mm {fault['time']:.3f} s {at}"
    return f"robot {fault['robot']} is over its {kind} by {number(size)} {_UNITS[kind]} {at}"
