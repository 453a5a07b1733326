"""`warehouse tables floors`: the rule and policies on named floors, benchmark maps and floors drawn at random."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from train.evaluation.rollout import Experiment, make_experiment
from train.tables.benchmark.maps import movingai_warehouse
from train.tables.floors.figures import GENERATED, RULE, floors_tables
from train.tables.options import StudyOptions
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.layouts import make_layout
from warehouse_env.maps.movingai import write_map
from warehouse_env.planning import make_planner

LAYOUTS = ("paper46", "narrow", "single_lane")
AISLES = (1, 2)  # [cells] of the MovingAI warehouses
DRAWN = range(701, 721)  # seeds of `aisles`: nothing was trained or chosen on these floors
LARGE = {92: (256,), 130: (256, 512), 184: (512, 1024), 260: (1024,)}  # [cells] of a side of `blocks`, and its robots:
# as many a cell as 32 or 64 on paper46
ALONE = 25  # episodes of a single robot for each of these: the shares of all others rest on it
SECONDS = 600.0
SEED = 26_000_000  # of the first episode, beside --seed: no training and no choice has used seeds from here on


@dataclass(frozen=True)
class Floors(StudyOptions):
    """Drive policies and the rule on named floors, benchmark maps and 20 floors drawn at random, 16 to 128 robots, and
    on large floors with 256 to 1,024.
    """

    name = "floors"

    policy: tuple[str, ...] = ("threaded_ppo",)
    """Policies to hold against the rule: names, or folders of trained ones."""
    robots: tuple[int, ...] = (16, 32, 64, 128)
    """Numbers of robots, but on large floors."""
    runs: int = 4
    """Episodes of each floor; of drawn ones there is one each, of large ones half as many."""
    planner: tuple[str, ...] = (EnvConfig.planner,)
    """Planners of routes; a second table holds those after the first against it."""
    maps: tuple[str, ...] = ()
    """Layouts to drive on, instead of all floors."""

    def run(self) -> None:
        """Drive what is missing, then write the tables."""
        self.check_writable()
        begin = time.perf_counter()
        rows = self.drive(list(self.experiments(self.folder)))
        self.write("Policies on many floors", floors_tables(rows, self.policy, self.planner))
        print(self.written(begin))

    def experiments(self, folder: Path) -> Iterator[Experiment]:
        """Return what is driven: on every floor one robot alone by the rule, then the rule and every policy."""
        first = SEED + self.seed
        if not self.planner:
            raise ConfigError("--planner needs at least one name")
        for planner in self.planner:
            make_planner(planner)  # a wrong name is said before anything drives
        if not self.robots or min(self.robots) < 2:
            raise ConfigError(f"--robots {self.robots} must be numbers of at least 2")
        for number, (base, fleets, many) in enumerate(self._floors(folder)):
            drawn = str(base.get("layout", "")).startswith(GENERATED)
            seed = first + number if drawn else first
            alone = EnvConfig(num_agents=1, planner=self.planner[0], **base)
            yield make_experiment(RULE, alone, ALONE * many, SECONDS, seed)
            for robots, planner in itertools.product(fleets, self.planner):
                env = EnvConfig(num_agents=robots, planner=planner, **base)
                for policy in (RULE, *self.policy):
                    yield make_experiment(policy, env, many, SECONDS, seed)

    def _floors(self, folder: Path) -> Iterator[tuple[dict[str, Any], tuple[int, ...], int]]:
        """Return for each floor the fields of EnvConfig that name it, the numbers of robots, and how many episodes.

        Benchmark maps are written to `folder`.
        """
        for layout in self.maps or (*LAYOUTS, *(f"{GENERATED}seed={seed}" for seed in DRAWN)):
            make_layout(layout)  # a wrong name is said before anything drives
            yield {"layout": layout}, self.robots, 1 if layout.startswith(GENERATED) else self.runs
        for aisle in () if self.maps else AISLES:
            grid = movingai_warehouse(aisle)
            path = folder / f"{grid.name}.map"
            write_map(grid, path)
            yield {"layout": str(path)}, self.robots, self.runs
        for side, fleets in ({} if self.maps else LARGE).items():
            yield {"layout": f"blocks:rows={side},columns={side}"}, fleets, max(1, self.runs // 2)
