"""`warehouse execute`: drive the plan of a grid planner with real bodies -> a row, a table, a recording."""

import bisect
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import tyro

from train.commands.layouts import BY_MAP
from train.execute.delays import DelayClock, Delays, read_delays
from train.execute.drive import Drive
from train.execute.lifelong import plan_lifelong
from train.execute.motions import Curves
from train.execute.order import ROUNDS, Order, find_order, why_stuck
from train.execute.plan import GridPlan, path_of
from train.execute.read import read_plan
from train.learning.config import HELD_OUT_SEED
from train.reporting.report import Table, make_progress, number
from train.reporting.rows import Row, RowFile, plain
from warehouse_env import __version__
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, counted
from warehouse_env.files import check_writable, write_text
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.simulator import Simulator

_STILL = 60.0  # [s] without the end of a motion after which nothing more is expected
_LONGEST = 10  # waits that are listed
_CONTACTS = ("collisions_robot", "collisions_shelf", "collisions_per_km", "near_misses", "min_clearance_m")


@dataclass(frozen=True)
class Execute(Checked):
    """Drive the plan of a grid planner with bodies that accelerate, turn and are late: how much of it is left?

    Before the drive, it says whether an order was found in which all can drive, or which robots block each other.

    Examples: warehouse execute paths.txt --map warehouse.map;
    warehouse execute --grid-planner pibt --layout paper46 --robots 64
    """

    plan: tyro.conf.Positional[Path | None] = None
    """File of a plan: of the League of Robot Runners (JSON), of the MAPF Tracker (CSV), of pypibt or lacam (a line a
    step), or of CBS, EECBS, MAPF-LNS2 and PBS (a line a robot)."""
    scen: Path | None = None
    """The scenarios of a plan of the MAPF Tracker, a MovingAI .scen file."""
    layout: Annotated[str, BY_MAP] = EnvConfig.layout
    """The floor: a name of `warehouse layouts`, a file NAME.map or NAME.yaml, or your own, FILE.py:FUNCTION."""
    grid_planner: str | None = None
    """Instead of a file, a planner that plans lifelong tasks in windows: pibt, or your own, FILE.py:CLASS."""
    robots: int = 16
    """Robots of --grid-planner."""
    steps: int = 200
    """Steps that --grid-planner plans; at full speed, a step of a cell takes 0.67 s."""
    window: int = 1
    """Steps after which --grid-planner plans anew."""
    seconds: float = 600.0
    """Simulated time after which the drive ends [s], if the plan has not ended before."""
    delay_probability: float = 0.0
    """Probability that a robot is held up, each second."""
    delay_seconds: int = 2
    """How long it is held up then [s]."""
    delays: Path | None = None
    """Instead, a problem file of the League of Robot Runners 2026: delays as its `delayConfig` draws them."""
    seed: int = HELD_OUT_SEED
    """Seed of the tasks of --grid-planner, and of the delays."""
    json: Path | None = None
    """File to which a row is added, as JSON lines (OUT/rows.jsonl)."""
    out: Path = Path("results/execute")
    """Folder for the row, the table and episode.npz, which `warehouse replay` and `audit` take."""
    ranges: ClassVar = {
        "robots": (1, 10_000), "steps": (1, 1_000_000), "window": (1, 10_000), "seconds": (1.0, 1e6),
        "delay_probability": (0.0, 1.0), "delay_seconds": (1, 3600), "seed": (0, 2**62),
    }  # fmt: skip

    def run(self) -> None:
        """Plan or read, order, drive; print what was lost where."""
        if (self.plan is None) == (self.grid_planner is None):
            raise ConfigError("name a file with a plan, or a --grid-planner")
        if self.delays is not None and self.delay_probability:
            raise ConfigError("draw delays by --delays or by --delay-probability, not by both")
        if self.scen is not None and self.plan is None:
            raise ConfigError("--scen goes with a plan of the MAPF Tracker; leave it out")
        rows_path = self.json or self.out / "rows.jsonl"
        for path in (self.out / "table.md", self.out / "episode.npz"):
            check_writable(path)
        plan, config = self._plan()
        delays = self._delays(config)
        curves = Curves(Simulator(config.replace(num_agents=1), 1))
        with make_progress() as progress:
            bar = progress.add_task("order the motions", total=ROUNDS)
            order = find_order(plan, curves, lambda left: progress.advance(bar))
        stuck = why_stuck(order, plan)
        what = f"{counted(config.num_agents, 'robot')}, {plan.makespan} steps, {sum(map(len, order.own)):,} motions"
        told = "no order was found in which all can be driven" if stuck else "all can be driven"
        print(f"{what}: {told}", *stuck, sep="\n  ", flush=True)
        drive = self._drive(order, curves, config, delays)
        row = self._row(plan, order, drive, delays)
        with RowFile(rows_path, keep=True) as file:
            file.add([row])
        table = _table(row, _waits(drive, order, plan))
        table.print()
        write_text(self.out / "table.md", "\n".join([table.markdown(), *stuck]) + "\n")
        drive.recorder.episode.save(self.out / "episode.npz")
        print(f"wrote the row to {rows_path}, the table and the episode to {self.out}")

    def _plan(self) -> tuple[GridPlan, EnvConfig]:
        base = EnvConfig(self.layout, self.robots, "astar_turns", action_type="raw")
        steps = max(1, round(self.seconds / (base.time_step * base.action_repeat)))
        if self.plan is not None:
            plan = read_plan(self.plan, make_layout(self.layout), self.scen)
        else:
            with make_progress() as progress:
                bar = progress.add_task(f"plan by {self.grid_planner}", total=self.steps)
                plan = plan_lifelong(
                    str(self.grid_planner), base, self.steps, self.window, self.seed,
                    lambda step: progress.update(bar, completed=step),
                )  # fmt: skip
        return plan, base.replace(num_agents=plan.cells.shape[1], max_steps=steps)

    def _delays(self, config: EnvConfig) -> Delays | None:
        if self.delays is not None:
            return read_delays(self.delays, make_layout(self.layout).cell_size / config.robot.max_speed)
        if not self.delay_probability:
            return None
        return Delays(1.0, self.delay_probability, self.delay_seconds, self.delay_seconds)

    def _drive(self, order: Order, curves: Curves, config: EnvConfig, delays: Delays | None) -> Drive:
        drive, robots = Drive(order, curves, config), config.num_agents
        clock = None if delays is None else DelayClock(delays, robots, np.random.default_rng([self.seed, 1]))
        step, nobody = config.time_step * config.action_repeat, np.zeros(robots, np.bool_)
        still, ended = 0.0, 0
        with make_progress() as progress:
            bar = progress.add_task("drive", total=sum(map(len, order.own)))
            for k in range(config.max_steps):
                if drive.over or still > _STILL:
                    break
                drive.step(nobody if clock is None else clock.held(k * step))
                before, ended = ended, sum(drive.done)
                still = 0.0 if ended > before else still + step
                progress.update(bar, completed=ended)
        return drive

    def _row(self, plan: GridPlan, order: Order, drive: Drive, delays: Delays | None) -> Row:
        config = drive.simulator.config
        robots, step = config.num_agents, config.time_step * config.action_repeat
        seconds, tasks = max(drive.simulator.seconds(0), step), sum(map(len, _task_times(plan, drive)))
        move = drive.simulator.grid.cell_size / config.robot.max_speed
        planned = max(plan.makespan, 1) / plan.ticks * move
        return dict(plain({
            "plan": str(self.plan or self.grid_planner), "layout": self.layout, "robots": robots,
            "window": None if self.plan else self.window, "seed": self.seed,
            "delays": None if delays is None else vars(delays),
            "steps": plan.makespan, "planned_s": planned, "seconds": seconds, "whole": drive.over,
            "deadlocks": len(order.cycles), "motions": sum(map(len, order.own)), "motions_done": sum(drive.done),
            "tasks": sum(map(len, plan.tasks)), "tasks_done": tasks,
            "goals_per_robot_hour": 3600.0 * tasks / robots / seconds,
            "planned_goals_per_robot_hour": 3600.0 * sum(map(len, plan.tasks)) / robots / planned,
            "waiting_share": drive.waited.total() * step / robots / seconds, "off_arc_m": drive.off,
            **{name: value for name, value in drive.simulator.episode_metrics(0).items() if name in _CONTACTS},
            "version": __version__,
        }))  # fmt: skip


def _task_times(plan: GridPlan, drive: Drive) -> list[list[float]]:
    """Return when [s] each robot finished the tasks of the plan that it finished."""
    found = []
    for i, steps in enumerate(plan.tasks):
        cells, ended = path_of(plan.cells[:, i])[1], [0.0, *drive.ended[i]]
        places = (bisect.bisect_right(cells, step) - 1 for step in steps)
        found.append([ended[k] for k in places if k < len(ended)])
    return found


def _waits(drive: Drive, order: Order, plan: GridPlan) -> list[str]:
    """Return where robots waited longest, and for whom."""
    places: dict[tuple[int, int], Counter[str]] = {}
    motions, step = order.motions, drive.simulator.config.time_step * drive.simulator.config.action_repeat
    for (own, other), steps in drive.waited.items():
        i, j = int(motions.robot[own]), int(motions.robot[other])
        row, column = plan.cells[motions.leaves[own], i].tolist()
        places.setdefault((row, column), Counter())[f"{i} for {j}"] += steps
    longest = sorted(places.items(), key=lambda place: -place[1].total())[:_LONGEST]
    return [
        f"cell {cell}: {number(who.total() * step)} s (robot {', '.join(one for one, _ in who.most_common(3))})"
        for cell, who in longest
    ]


def _table(row: Row, waits: Sequence[str]) -> Table:
    lines = (
        ("steps of the plan", number(row["steps"]), ""),
        ("time [s]", number(row["planned_s"]), number(row["seconds"])),
        ("motions", str(row["motions"]), str(row["motions_done"])),
        ("tasks", str(row["tasks"]), str(row["tasks_done"])),
        ("goals/robot-h", number(row["planned_goals_per_robot_hour"]), number(row["goals_per_robot_hour"])),
        ("waiting for others %", "", number(100 * row["waiting_share"])),
        ("collisions", "0", number(row["collisions_robot"] + row["collisions_shelf"])),
    )
    note = "planned: a cell takes its length at full speed. Waited longest at " + "; ".join(waits) if waits else ""
    title = f"{Path(row['plan']).name} on {Path(row['layout']).name} with {counted(row['robots'], 'robot')}"
    return Table(title, ("", "planned", "driven"), lines, note)
