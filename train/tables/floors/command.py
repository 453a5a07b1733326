"""`warehouse tables --floors`: the rule and policies on named floors, benchmark maps and floors drawn at random."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from train.evaluation.episodes import play
from train.evaluation.rollout import Experiment, make_experiment
from train.reporting.rows import RowFile, check_writable, whole_rows, write_text
from train.tables.benchmark.maps import movingai_warehouse
from train.tables.floors.figures import GENERATED, RULE, floors_tables
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.layouts import make_layout
from warehouse_env.maps.movingai import write_map

LAYOUTS = ("paper46", "narrow", "single_lane")
AISLES = (1, 2)  # [cells] of the MovingAI warehouses
DRAWN = range(541, 561)  # seeds of `aisles`: nothing was trained or chosen on these floors
ROBOTS = (16, 32, 64, 128)
EPISODES = 4  # a floor; one on each that is drawn
ALONE = 25  # episodes of a single robot for each of these: the shares of all others rest on it
SECONDS = 600.0
SEED = 22_000_000  # of the first episode, beside --seed: no training and no choice has used seeds from here on


@dataclass(frozen=True)
class Floors(Checked):
    """Policies beside the rule on many floors, with growing numbers of robots."""

    out: Path = Path("results/tables")
    json: Path | None = None  # OUT/floors/rows.jsonl if None
    runs: int | None = None  # episodes of each floor that is not drawn; EPISODES if None
    seed: int = 0
    processes: int = 2
    fresh: bool = False
    maps: tuple[str, ...] = ()  # layouts instead of all floors
    policy: tuple[str, ...] = ()  # names or folders; threaded_ppo if empty
    robots: tuple[int, ...] = ROBOTS

    def run(self) -> None:
        """Drive what is missing, then write the tables."""
        folder = self.out / "floors"
        check_writable(folder / "README.md")
        begin = time.perf_counter()
        path = self.json or folder / "rows.jsonl"
        file = RowFile(path, keep=not self.fresh)
        old = [] if self.fresh else whole_rows(path)
        rows, _ = play(list(self.experiments(folder)), file, old, processes=self.processes)
        tables = floors_tables(rows, self.policies)
        for table in tables:
            table.print()
        text = "\n".join(table.markdown() for table in tables)
        write_text(folder / "README.md", f"# Policies on many floors\n\n{text}")
        print(f"wrote the tables to {folder / 'README.md'} in {time.perf_counter() - begin:.0f} s; the rows are {path}")

    @property
    def policies(self) -> tuple[str, ...]:
        """The policies that are held against the rule."""
        return self.policy or ("threaded_ppo",)

    def experiments(self, folder: Path) -> Iterator[Experiment]:
        """Return what is driven: on every floor one robot alone by the rule, then the rule and every policy."""
        episodes, first = EPISODES if self.runs is None else self.runs, SEED + self.seed
        if not self.robots or min(self.robots) < 2:
            raise ConfigError(f"--robots {self.robots} must be numbers of at least 2")
        for number, base in enumerate(self._floors(folder)):
            drawn = str(base["layout"]).startswith(GENERATED) if "layout" in base else False
            many, seed = (1, first + number) if drawn else (episodes, first)
            alone = EnvConfig(num_agents=1, planner="astar_turns", **base)
            yield make_experiment(RULE, alone, ALONE * many, SECONDS, seed)
            for robots in self.robots:
                env = EnvConfig(num_agents=robots, planner="astar_turns", **base)
                for policy in (RULE, *self.policies):
                    yield make_experiment(policy, env, many, SECONDS, seed)

    def _floors(self, folder: Path) -> Iterator[dict[str, Any]]:
        """Return the fields of EnvConfig that name each floor; benchmark maps are written to `folder`."""
        for layout in self.maps or (*LAYOUTS, *(f"{GENERATED}seed={seed}" for seed in DRAWN)):
            make_layout(layout)  # a wrong name is said before anything drives
            yield {"layout": layout}
        for aisle in () if self.maps else AISLES:
            grid = movingai_warehouse(aisle)
            path = folder / f"{grid.name}.map"
            write_map(grid, path)
            yield {"map_file": str(path)}
