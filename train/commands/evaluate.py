"""`warehouse evaluate`, `robust` and `benchmark`: policies over held-out episodes -> rows, a table, pictures."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from train.commands.layouts import BY_MAP
from train.evaluation.disturbances import DISTURBANCES, UNDISTURBED
from train.evaluation.episodes import EpisodesJob
from train.evaluation.fixed_set import SHIPPED, VERSION, benchmark_tables, experiments
from train.evaluation.jobs import Job
from train.evaluation.places import NOTES, PAGE
from train.evaluation.robustness import robust_table
from train.evaluation.rollout import Experiment, make_experiment
from train.evaluation.workers import RowOptions
from train.job_files import OwnSensors
from train.kinds import Fleet, Work
from train.learning.config import HELD_OUT_SEED
from train.reporting.columns import read_groups, regrouped
from train.reporting.report import Table, evaluation_table, require_charts
from train.reporting.rows import Row, RowFile, read_rows, whole_rows
from warehouse_env.checked import Checked
from warehouse_env.config import ArrivalMode, EnvConfig
from warehouse_env.errors import ConfigError, check_known
from warehouse_env.files import check_writable, write_text
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import make_planner
from warehouse_env.traffic_spec import OWN, TRAFFIC, read_traffic


@dataclass(frozen=True)
class Drive(OwnSensors):
    """Options of the worlds to drive in, which override those of a policy."""

    planner: str = EnvConfig.planner
    """Planner of the routes: a name of `warehouse planners`, or one of your own, FILE.py:CLASS or MODULE:CLASS."""
    traffic: str = OWN
    """How robots meet. own: as the policy needs; none; routes: replan around others; shield: also brake before a
    contact; assist: also right of way near robots that have stood for 30 s; rules: right of way everywhere. Switches of
    TrafficSpec may follow, as in own:routes=false or rules:margin=0.1."""
    people: int | None = None
    """Number of people who walk among the robots (default: none)."""
    arrival: ArrivalMode | None = None
    """When a robot has reached its goal. pass (default): when it drives by; stop: when it stands there; pose: when it
    also has the right heading."""
    seed: int = HELD_OUT_SEED
    """First seed, the others follow; no training uses seeds from the default on."""

    def chosen(self) -> dict[str, Any]:
        """Return the fields of EnvConfig that the options set; `traffic` is a checked text for `read_traffic`."""
        read_traffic(self.traffic, TRAFFIC["rules"])
        given = {name: getattr(self, name) for name in ("traffic", "people", "arrival")}
        return {name: value for name, value in given.items() if value not in (None, OWN)}


@dataclass(frozen=True)
class Working(Fleet, Work, Drive):
    """Options of worlds with kinds of robots, service, orders or batteries."""

    def chosen_for(self, robots: int) -> dict[str, Any]:
        """Return the fields of EnvConfig that the options set for so many robots; --arrival overrides that of work."""
        kinds = self.kinds()
        return ({} if kinds is None else kinds.of(robots)) | self.work() | self.chosen()


@dataclass(frozen=True)
class Driven(Checked):
    """What is driven where; the first options of the help."""

    policy: tuple[str, ...] = ("follow", "brake", "reinforce", "ppo", "shielded")
    """Policies to compare: names of `warehouse policies`, folders of trained policies, or your own, FILE.py:CLASS or
    MODULE:CLASS; epibt is a central planner that drives all robots."""
    layout: Annotated[tuple[str, ...], BY_MAP] = (EnvConfig.layout,)
    """Floors to drive on: names of `warehouse layouts`, files NAME.map, NAME.yaml of map_server with parameters, as in
    hall.yaml:cell=0.75, or your own, FILE.py:FUNCTION."""
    robots: tuple[int, ...] = (16,)
    """Numbers of robots."""
    episodes: int = 5
    """Episodes of each policy, floor and number of robots."""
    seconds: float = 600.0
    """Simulated time of an episode [s]."""
    tasks: str = "lifelong"
    """lifelong: a new goal after every arrival; one_shot: one goal per robot, which then parks; or starts and goals by
    your own sampler, FILE.py:CLASS."""


@dataclass(frozen=True)
class Episodes(Working, RowOptions, Driven):
    """Options of the episodes to drive and of the files to write."""

    out: Path = Path("results/evaluate")
    """Folder for the rows, the table and the pictures."""

    def tabulate(
        self, jobs: Sequence[Job], table_of: Callable[[Sequence[Row]], Table], notes: RowFile | None = None,
        resumes: bool = True,
    ) -> list[Row]:  # fmt: skip
        """Do the jobs, print and write the table and the rows; return the rows. notes, resumes: see `rows_of`."""
        rows = self.rows_of(jobs, self.out / "table.md", notes, resumes=resumes)
        table = table_of(rows)
        table.print()
        write_text(self.out / "table.md", table.markdown())
        return rows

    def experiments(self, disturbance: str | None = None) -> list[Experiment]:
        """Return the product of floors, robot counts and policies, checked as far as possible."""
        for name, values in (("policy", self.policy), ("robots", self.robots), ("layout", self.layout)):
            if not values:
                raise ConfigError(f"--{name} needs at least one value")
        make_planner(self.planner)
        for name in self.layout:
            self.note_orders(make_layout(name))  # raises before anything drives
        experiments = []
        for layout in self.layout:
            for robots in dict.fromkeys(self.robots):
                base = EnvConfig(layout, robots, self.planner, self.tasks)
                chosen = self.chosen_for(robots)
                experiments += [
                    make_experiment(policy, base, self.episodes, self.seconds, self.seed, chosen, disturbance)
                    for policy in dict.fromkeys(self.policy)
                ]
        return experiments


@dataclass(frozen=True)
class Evaluate(Episodes):
    """Drive policies through held-out episodes on layouts or maps; print means with 95% intervals."""

    group: tuple[str, ...] = ()
    """Trainings of one recipe that are shown as one policy, with intervals over trainings and episodes, as in
    mine=runs/a,runs/b,runs/c; those that are not among --policy are driven as well."""
    pictures: bool = True
    """Draw a bar chart of collisions and goals."""
    report: Path | None = None
    """Folder for a page to read and share: the table, charts, heat maps, and replays of the worst episodes."""

    def run(self) -> None:
        """Play all experiments, print the table, write rows, pictures and the report."""
        groups = read_groups(self.group)
        members = [one for own in groups.values() for one in own]
        experiments = replace(self, policy=(*self.policy, *members)).experiments()

        def shown(rows: Sequence[Row]) -> list[Row]:
            return regrouped(rows, groups, self.policy)

        if self.pictures or self.report is not None:
            require_charts()
        if self.report is not None:
            check_writable(self.report / PAGE)
        with RowFile(self.report and self.report / NOTES, keep=self.resume) as notes:
            jobs = [EpisodesJob(one, noted=self.report is not None) for one in experiments]
            rows = self.tabulate(jobs, lambda rows: evaluation_table(shown(rows)), notes)
        if self.pictures:
            from train.evaluation.pictures import evaluation_pictures

            evaluation_pictures(shown(rows), self.out)
        drawn = " and the pictures" if self.pictures else ""
        page = ""
        if self.report is not None:
            from train.evaluation.report_page import write_report

            noted = whole_rows(self.report / NOTES)
            page = f", the report to {write_report(rows, shown(rows), noted, experiments, self.report, self.rows_path)}"
        print(f"wrote the rows to {self.rows_path}, the table{drawn} to {self.out}{page}")


@dataclass(frozen=True)
class Robust(Episodes):
    """Drive policies with other bodies, worse sensors, lost messages or a broken robot; print what holds and breaks."""

    policy: tuple[str, ...] = ("greedy", "reinforce", "ppo", "shielded")
    """Policies to compare, named as for `warehouse evaluate`."""
    layout: Annotated[tuple[str, ...], BY_MAP] = ("paper46", "narrow")
    """Floors to drive on, named as for `warehouse evaluate`."""
    robots: tuple[int, ...] = (16, 32)
    """Numbers of robots."""
    disturbance: tuple[str, ...] = tuple(DISTURBANCES)
    """Disturbances, each compared with the undisturbed world, which is always driven."""
    episodes: int = 3
    """Episodes of each disturbance, policy, floor and number of robots, with the same seeds."""
    seconds: float = 300.0
    """Simulated time of an episode [s]."""
    out: Path = Path("results/robust")
    """Folder for the rows and the table."""

    def run(self) -> None:
        """Play everything, print the table, write rows and table."""
        check_known("disturbance", self.disturbance, DISTURBANCES)
        names = dict.fromkeys((UNDISTURBED, *self.disturbance))
        self.tabulate([EpisodesJob(one) for name in names for one in self.experiments(name)], robust_table)
        print(f"wrote the rows to {self.rows_path}, the table to {self.out}")


@dataclass(frozen=True)
class Benchmark(RowOptions, OwnSensors):
    """Drive policies through a fixed set of floors, fleets and seeds, and show them beside the shipped policies.

    It is a preset of `evaluate` that is the same for everybody. Without --policy it shows the shipped policies alone.
    Example: warehouse benchmark --policy runs/mine
    """

    policy: tuple[str, ...] = ()
    """Policies to drive: names of `warehouse policies`, folders of trained ones, or your own, FILE.py:CLASS or
    MODULE:CLASS."""
    out: Path = Path("results/benchmark")
    """Folder for the rows and the table."""

    usual_processes: ClassVar[int] = min(os.cpu_count() or 1, 8)

    def run(self) -> None:
        """Drive all requested episodes, then print the tables."""
        driven = self._drive() if self.policy else []
        shipped = [row for row in read_rows(SHIPPED) if row["policy"] not in self.policy]
        tables = benchmark_tables([*shipped, *driven])
        for table in tables:
            table.print()
        if driven:
            title = f"# Benchmark, version {VERSION} of the set\n\n"
            write_text(self.out / "table.md", title + "\n".join(table.markdown() for table in tables))
            print(f"wrote the rows to {self.rows_path}, the table to {self.out}")

    def _drive(self) -> list[Row]:
        # errors come before anything drives
        listed = [one for policy in dict.fromkeys(self.policy) for one in experiments(policy)]
        tracks = [track for track, experiment in listed for _ in experiment.episodes]
        rows = self.rows_of([EpisodesJob(one) for _, one in listed], self.out / "table.md")
        return [{**row, "track": track} for track, row in zip(tracks, rows, strict=True)]
