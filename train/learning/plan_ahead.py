"""Plan tables that a training makes before it begins, where they pay."""

import math
from functools import partial

from train.books import book_of
from train.learning.config import TrainingConfig
from train.learning.floors import draws_floors
from train.reporting.report import make_progress, tell
from warehouse_env.simulation.traffic.live import live_planner

DECISIONS_PER_SECOND = 30_000  # of a thread, about
GOALS_PER_ROBOT_HOUR = 60.0  # about


def plan_ahead(config: TrainingConfig) -> None:
    """Make the plan tables of those floors on which a training reaches more goals than the table has plans.

    Live routes of the same planner need no plans.
    """
    for layout in (one for one in config.layouts if not draws_floors(one)):
        env = config.env(layout, config.robots[0])
        seconds = _decisions(config) / len(config.layouts) * env.time_step * env.action_repeat
        book = book_of(env)
        places = len(book.grid.endpoints[2])
        live = env.traffic_spec.routes and live_planner(env).name == book.planner.name
        if book.has_table or live or seconds / 3600.0 * GOALS_PER_ROBOT_HOUR < places**2:
            continue
        tell(f"plans all {places * (places - 1):,} routes between the endpoints of {layout} once")
        with make_progress() as bar:
            book.plan_all(partial(bar.track, description=f"routes of {layout}"))


def _decisions(config: TrainingConfig) -> float:
    """Return how many decisions of one robot a training makes, about."""
    by_time = math.inf if config.minutes is None else 60.0 * config.minutes * config.threads * DECISIONS_PER_SECOND
    return min(by_time, math.inf if config.total_steps is None else config.total_steps)
