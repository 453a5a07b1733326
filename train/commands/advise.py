"""`warehouse advise`: how many robots a floor supports, where they wait, and which change helps, as a page."""

import dataclasses
import os
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from agents import POLICIES, policy_config
from train.advice.advice_page import FOLDER, advice_page, hall_parts, loads_table, places_table, write_floor
from train.advice.answer import advise, answer
from train.advice.capacity import for_kinds, most_with_a_start
from train.advice.trials import AdvicePlan, TimeBudget
from train.commands.layouts import BY_MAP, check_connected
from train.evaluation.jobs import Progress, Runner
from train.evaluation.rollout import check_driver, config_of
from train.evaluation.workers import GOES_ON, RowOptions
from train.job_files import OwnSensors
from train.kinds import Fleet, Work
from train.reporting.page import PagePart
from train.reporting.report import make_console, make_progress, require_charts
from train.reporting.rows import RowFile
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, MapWarning
from warehouse_env.files import check_writable
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.hall import is_hall, read_hall
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import make_planner

MOST = 1024  # robots tried if --most does not say otherwise
SECONDS, ORDERED = 300.0, 1800.0  # [s] of an episode, and of one with orders, twice the time until drawn ones are due


@dataclass(frozen=True)
class Advise(Fleet, Work, RowOptions, OwnSensors):
    """Find how many robots a floor supports, where they wait, and which change of the floor would help.

    The command drives more and more robots between pick faces and stations, then numbers around the best, under the
    policy that is best there. It measures the choice again on new seeds. Then it opens aisles at the worst
    bottlenecks, in pairs of episodes with the floor as it is. Robots with orders are judged by orders.
    Example: warehouse advise --map hall.map --minutes 10 --goals 4000
    """

    layout: Annotated[str | None, BY_MAP] = None
    """Floor: a name of `warehouse layouts`, a file NAME.map, or NAME.yaml of map_server, as in hall.yaml:cell=0.75,
    with one-way cells beside it in NAME.oneway if there are any, or your own, FILE.py:FUNCTION."""
    goals: float | None = None
    """Also find how many robots reach this many goals, or orders, an hour, all together."""
    fleet: Path | None = None
    """Other kinds of robots: a JSON file, as [{"share": 1, "robot": {"length": 1.4, "max_speed": 0.8}}]; if shares add
    up to less than 1, the others are default robots."""
    policy: tuple[str, ...] = ()
    """Policies to choose from, names or folders (the shipped ones that rule out contact); also epibt, a central
    planner."""
    minutes: float = 5.0
    """Time to spend [min], without compilation at first use; more minutes give more episodes and narrower intervals."""
    episodes: int | None = None
    """Episodes of everything instead of a time: the same advice on every machine, however long it takes."""
    seconds: float | None = None
    """Simulated time of an episode [s] (300, with orders 1,800)."""
    most: int = MOST
    """Most robots to try."""
    planner: str = "astar_turns"
    """Planner of the routes; the default is exact, since ant colonies plan longer than robots drive on large floors."""
    seed: int = 0
    """First seed; the others count up from it."""
    out: Path = Path("results/advice")
    """Folder for the rows and the page."""

    usual_processes: ClassVar[int] = min(os.cpu_count() or 1, 8)
    ranges: ClassVar = {
        "minutes": (0.01, 1e5), "seconds": (1.0, 1e6), "episodes": (2, 1_000), "most": (1, 100_000),
        "seed": (0, 2**62), "goals": (1e-3, 1e9),
    }  # fmt: skip

    def run(self) -> None:
        """Drive, print the answer, write rows and page."""
        grid, narrow = self._floor()
        for text in narrow:  # before the long run, since it may call for another command
            warnings.warn(f"{grid.name}: {text}", MapWarning, stacklevel=2)
        make_planner(self.planner)
        check_connected(grid)
        page = self.out / "index.html"
        check_writable(page)
        require_charts()
        plan = dataclasses.replace(self._plan(grid), narrow=narrow)
        self._check(plan)
        plan = dataclasses.replace(plan, most=most_with_a_start(plan))
        with self.file() as file, closing(self.workers()) as workers:
            plan = dataclasses.replace(plan, processes=workers.width)
            clock, begin = TimeBudget(None if self.episodes else self.minutes), time.monotonic()
            with (
                self._bar(clock, file) as moved,
                Runner(file, file.old(), workers, goes_on=GOES_ON, progress=moved) as drive,
            ):
                advice = advise(plan, drive, clock)
        loads_table(advice).print()
        places_table(advice).print()
        console = make_console(sys.stdout)
        for text in answer(advice):
            console.print(text.replace("*", "").replace("`", ""))
        advice_page(advice, self._understood(grid), write_floor(advice, self.out)).write(page)
        print(
            f"wrote {file.count:,} rows to {file.path} and the page to {page}, with the floor to take away in "
            f"{self.out / FOLDER}, in {time.monotonic() - begin:.0f} s"
        )

    def _check(self, plan: AdvicePlan) -> None:
        """Raise what is wrong with a policy or with the work, before the start."""
        kinds = {} if plan.kinds is None else plan.kinds.each()
        for policy in plan.policies:
            check_driver(policy, config_of(policy, EnvConfig(planner=self.planner), {**plan.work, **kinds}))

    def _plan(self, grid: GridMap) -> AdvicePlan:
        """Return the plan."""
        most = min(self.most, len(grid.endpoints[2]) - 1, len(grid.free_cells) // 4)
        policies, work = tuple(dict.fromkeys(self.policy)) or contact_free(), self.work()
        seconds = self.seconds or (ORDERED if "orders" in work else SECONDS)
        self.note_orders(grid)
        return AdvicePlan(
            grid, policies, self.planner, seconds, self.seed, self.episodes, max(1, most), self.goals, work=work,
            kinds=self.kinds(),
        )  # fmt: skip

    def _floor(self) -> tuple[GridMap, tuple[str, ...]]:
        """Return the floor for the robots, and where their bodies do not fit."""
        if self.layout is None:
            raise ConfigError("name the floor with --layout NAME_OR_FILE")
        grid, kinds = make_layout(self.layout), self.kinds()
        return (grid, ()) if kinds is None else for_kinds(grid, kinds)

    def _understood(self, grid: GridMap) -> list[PagePart]:
        """Return how a hall's map was understood; nothing for another floor."""
        name = str(self.layout)
        return hall_parts(dataclasses.replace(read_hall(name), grid=grid), name) if is_hall(name) else []

    @contextmanager
    def _bar(self, clock: TimeBudget, file: RowFile) -> Iterator[Progress]:
        """Show how much of the time is over, or how many episodes are driven."""
        with make_progress() as progress:
            total = None if self.episodes else round(60 * self.minutes)
            bar = progress.add_task("1 robot", total=total)

            def moved(done: float, title: str) -> None:
                progress.update(bar, description=title, completed=file.count if total is None else round(clock.spent))

            yield moved


def contact_free() -> tuple[str, ...]:
    """Return the shipped policies with shield and right of way, which rule out contact."""
    specs = {name: policy_config(name, EnvConfig()).traffic_spec for name in POLICIES}
    return tuple(name for name, spec in specs.items() if spec.shield and spec.right_of_way)
