"""`warehouse benchmark`: a policy on the fixed set that every entry drives -> one file, and its place on the board."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from train.commands.evaluate import GOES_ON
from train.evaluation.episodes import play
from train.evaluation.workers import WorkerOptions
from train.leaderboard.board import board
from train.leaderboard.cases import experiments
from train.leaderboard.entry import SHIPPED, Entry, drive_again, faults, make_entry, read_entry, write_entry
from train.own import versions
from train.reporting.rows import RowFile, instead
from warehouse_env.errors import ConfigError, WarehouseError, shown
from warehouse_env.files import check_writable


@dataclass(frozen=True)
class Benchmark(WorkerOptions):
    """Drive a policy through the fixed set of floors, fleets and seeds that every entry drives; show the board.

    With --policy it writes one file with the version of the set, its hash and one of what the policy is made of.
    Without, it shows the board: the shipped entries and those in --entries. Example:
    warehouse benchmark --policy runs/mine
    """

    policy: str | None = None
    """Policy to drive: a name of `warehouse policies`, the folder of a trained one, a model of stable-baselines3
    (FILE.zip), or your own, FILE.py:CLASS or MODULE:CLASS."""
    name: str | None = None
    """What it is called on the board (the policy's name, or its file's, if left out)."""
    entries: tuple[Path, ...] = ()
    """Files of other entries to show beside the shipped ones."""
    check: bool = False
    """Check the files of --entries: hashes, all episodes there; with --policy some episodes are driven again."""
    again: int = 4
    """With --check and --policy, episodes to drive again."""
    out: Path = Path("results/benchmark")
    """Folder for the entry's file, and for its rows while it drives."""
    resume: bool = False
    """Keep the episodes that were driven before a stop."""
    overwrite: bool = False
    """Replace the episodes that were driven before."""

    usual_processes: ClassVar[int] = min(os.cpu_count() or 1, 8)

    def run(self) -> None:
        """Drive or check what is asked for, then show the board."""
        if self.name is not None and (Path(self.name).name != self.name or self.name in ("", "..")):
            raise ConfigError(f"--name {shown(self.name)} must be a plain name; the folder of the file is --out")
        entries = [read_entry(path) for path in self.entries]
        if self.check:
            self._check(entries)
            return
        if self.policy is not None:
            entries.append(self._drive(self.policy))
        listed = [read_entry(path) for path in sorted(SHIPPED.glob("*.json"))] + entries
        for table in board([entry for entry in listed if not any(faults(entry))]):
            table.print()
        for fault in (fault for entry in listed for fault in faults(entry)):
            print(f"not on the board: {fault}")

    def _drive(self, policy: str) -> Entry:
        name = self.name or Path(policy).name.removesuffix(".zip").replace(":", "-")
        path, rows_path = self.out / f"{name}.json", self.out / f"{name}.rows.jsonl"
        listed = list(experiments(policy))  # what is wrong is said before anything drives
        check_writable(path)
        tracks = [track for track, one in listed for _ in one.episodes]
        with RowFile(rows_path, self.resume, instead(self.overwrite)) as file:
            rows, _ = play([one for _, one in listed], file, file.old(), False, self.workers(), None, GOES_ON)
        entry = make_entry(name, versions(policy, "", "").get(policy, ""), zip(tracks, rows, strict=True))
        write_entry(entry, path)
        print(f"wrote the entry to {path}")
        return entry

    def _check(self, entries: Sequence[Entry]) -> None:
        if not entries:
            raise ConfigError("--check needs the files of --entries")
        found = [fault for entry in entries for fault in faults(entry)]
        if self.policy is not None and not found:
            made_of = versions(self.policy, "", "").get(self.policy, "")
            found = [f"{one.policy} was made of another {self.policy}" for one in entries if one.made_of != made_of]
            found += [fault for entry in entries for fault in drive_again(entry, self.policy, self.again)]
        for fault in found:
            print(fault)
        if found:
            raise WarehouseError(f"{len(found)} faults in {len(entries)} entries")
        again = f", {self.again} episodes driven again are the same" if self.policy is not None else ""
        print(f"{len(entries)} entries: whole, of this version's set{again}")
