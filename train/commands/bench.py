"""`warehouse bench`: measure speeds on this machine, as rows, tables, and ratios within the same run."""

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal, get_args

from train.reporting.report import Table, make_progress
from train.reporting.rows import Row, RowFile, read_rows, select
from warehouse_env import __version__
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError
from warehouse_env.threads import get_num_threads, set_num_threads

What = Literal["simulator", "reference", "pettingzoo", "vec_env", "cuda", "training", "peers"]

_ASKED = ("cuda", "peers")  # which need a GPU, and packages


@dataclass(frozen=True)
class Bench(Checked):
    """Measure agent-steps/s of the simulator, environments and trainers, and the step beside fixed work in C."""

    only: tuple[What, ...] = ()
    """What to measure (if left out, all but cuda, which needs a GPU, and peers, which needs VMAS, JaxMARL or CAMAR)."""
    seconds: float = 3.0
    """Time for each measurement, after its warm-up [s]."""
    json: Path | None = None
    """Write the rows to this file as JSON lines."""
    rows: Path | None = None
    """Measure nothing: print the tables of the rows in this file, as Markdown."""
    check: bool = False
    """Fail if a ratio of the step to the fixed work is a third below that of the release."""
    ranges: ClassVar = {"seconds": (0.001, 3600.0)}

    def run(self) -> None:
        """Measure and print; a row is written as soon as it is measured."""
        from train.benchmarks.parts import PARTS
        from train.benchmarks.reference import judge, origin

        if self.rows is not None:
            print("\n".join(table.markdown() for table in tables(read_rows(self.rows))))
            return
        if self.check and self.only and "reference" not in self.only:
            raise ConfigError("--check needs the part `reference`: name it in --only as well")
        chosen = [what for what in get_args(What) if what in self.only or (not self.only and what not in _ASKED)]
        source = {**origin(), "version": __version__}
        machine = {"cores": os.cpu_count(), "machine": platform.machine(), "python": platform.python_version()}
        file, rows, threads = RowFile(self.json), list[Row](), get_num_threads()
        try:
            with make_progress() as progress:
                bar = progress.add_task("", total=len(chosen))
                for what in chosen:
                    set_num_threads(threads)  # which the part before may have changed
                    progress.update(bar, description=what)
                    for measured in PARTS[what](self.seconds):
                        rows.append({"what": what, **measured, **source, **machine})
                        file.add(rows[-1:])
                        progress.update(bar, description=f"{what}: {len(rows)} rows")
                    progress.advance(bar)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(file.kept()) from None
        for table in tables(rows):
            table.print()
        print(file.written())
        if self.check:
            judge(rows)


def tables(rows: Sequence[Row]) -> list[Table]:
    """Return the tables of speeds, and of the step beside fixed work, as far as they were measured."""
    speeds = [row for row in rows if "agent_steps_per_s" in row]
    made = [_speeds(speeds)] if speeds else []
    if own := select(rows, what="reference"):
        from train.benchmarks.reference import reference_table

        made.append(reference_table(own))
    return made


def _speeds(rows: Sequence[Row]) -> Table:
    header = ("what", "worlds", "robots", "threads", "agent-steps/s", "spread", "where the time goes")
    cells = []
    for row in rows:
        low, high = row.get("low"), row.get("high")
        cells.append((
            str(row.get("simulator", row["what"])), *(str(row[name]) for name in ("envs", "agents", "threads")),
            _thousands(row["agent_steps_per_s"]),
            f"{_thousands(low)} to {_thousands(high)}" if low is not None and high is not None else "",
            ", ".join(f"{name} {100 * share:.0f}%" for name, share in row.get("shares", {}).items()),
        ))  # fmt: skip
    return Table("Speed", header, tuple(cells), "A simulator step here is 0.1 s.")


def _thousands(value: float) -> str:
    return f"{round(value):,}"
