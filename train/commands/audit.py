"""`warehouse audit`: check recorded or driven episodes for overlaps at every instant."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from train.commands.evaluate import Episodes
from train.evaluation.audit.jobs import DrivenEpisodes, RecordedEpisode, audit_table, faults_of, sentences
from train.evaluation.audit.watcher import Audit
from train.evaluation.disturbances import known
from train.evaluation.jobs import Job, Runner
from train.evaluation.workers import GOES_ON
from train.fleet.driven import load_simulated
from warehouse_env.errors import ConfigError
from warehouse_env.files import check_writable, write_text

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
        jobs = self._jobs()
        check_writable(self.out / "table.md")
        with (
            self.file_of(self.rows_path, resumes=not self.files) as file,
            Runner(file, file.old(), self.workers(), goes_on=GOES_ON) as run,
        ):
            rows = run(jobs)
        table = audit_table(rows)
        table.print()
        write_text(self.out / "table.md", table.markdown())
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
            disturbances = tuple(map(known, self.disturbance)) or (None,)
            experiments = [one for name in disturbances for one in self.experiments(name)]
            configs = [one.config for one in experiments]
            jobs = [DrivenEpisodes(one) for one in experiments]
        for config in configs:  # raises before anything drives
            Audit(config)
        return jobs
