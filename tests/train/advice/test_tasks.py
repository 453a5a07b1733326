"""Tasks as lifelong robots get them."""

from __future__ import annotations

import numpy as np

from train.advice.tasks import endpoint_tasks
from warehouse_env.maps.layouts import make_layout


def test_tasks_go_to_and_fro_between_picks_and_stations() -> None:
    grid = make_layout("single_lane")
    picks, stations = ({tuple(cell) for cell in cells.tolist()} for cells in (grid.picks, grid.stations))
    tasks = endpoint_tasks(grid, 50, np.random.default_rng(1))
    assert len(tasks) == 50
    for number, (start, goal) in enumerate(tasks):
        assert (start in picks and goal in stations) if number % 2 else (start in stations and goal in picks)
    assert len({start for start, _ in tasks[1::2]}) == 25  # picks come again only when all have been
    assert tasks == endpoint_tasks(grid, 50, np.random.default_rng(1))
