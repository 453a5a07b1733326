"""The traffic study: paired answers by hand, its report from rows, its pieces of work, and the k shortest paths."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from train.reporting.rows import Row, paired
from train.tables.traffic.command import Measurement, Traffic, report
from train.tables.traffic.figures import SAMPLE, answers, conflicts_of
from train.tables.traffic.jobs import Piece
from train.tables.traffic.routes import k_shortest
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning import path_length, validate


def routes_row(system: str, number: int, opposing: float, **more: Any) -> Row:
    row = {"part": "routes", "map": "narrow", "number": number, "system": system, "robots": 32, "price": 0.0}
    return {**row, "crossings": 0.1, "opposing": opposing, "paid": 0.01, "ms": 1.0, **more}


ROWS = [
    row
    for number, (alone, around) in enumerate([(0.9, 0.2), (1.1, 0.3), (1.0, 0.35)])
    for row in (
        routes_row("pf_aco", number, alone),
        routes_row("pf_aco, cost a move", number, around, price=2.0),
        routes_row("astar, cost a move", number, around, price=2.0),
        routes_row("astar", number, alone + 0.1),
    )
]


def test_pairs_are_of_one_map_and_draw() -> None:
    found = paired(ROWS[1::4], list(reversed(ROWS[0::4])), conflicts_of, SAMPLE)
    assert found.samples == 3
    assert found.mean == pytest.approx(-(0.7 + 0.8 + 0.65) / 3)
    assert paired(ROWS[1::4], [{**ROWS[0], "map": "paper46"}], conflicts_of, SAMPLE).samples == 0


def test_answers_are_plain() -> None:
    told = {line[0]: line[2] for line in answers(ROWS, ["narrow"]).cells}
    assert told["Does a cost a move keep the colony's routes apart?"].startswith("yes: -0.7")
    assert told["Better than A* with the same cost map?"].startswith("no difference told")
    assert told["Is a warm colony sooner done than a cold one?"] == "not run"


def test_a_report_is_made_from_rows_alone() -> None:
    text = "".join(table.markdown() for table in report(ROWS, ["narrow"]))
    assert "### Routes on narrow" in text
    assert "pf_aco, cost a move" in text


def test_a_changed_floor_is_planned_again_by_all() -> None:
    job = Measurement(Piece("replanning", "paper46", 0, 0))
    rows = job.run(lambda done: None).rows
    assert len(rows) == 3 * 5
    for row in rows:
        assert row["gap"] >= -1e-9
        assert row["job"]["part"] == "replanning"
        if row["system"] == "astar":
            assert row["optimal"]
    again = job.run(lambda done: None).rows
    assert [row["gap"] for row in rows] == [row["gap"] for row in again]


def test_the_k_shortest_paths_by_hand() -> None:
    occupied = np.zeros((3, 3), dtype=bool)
    occupied[1, 1] = True
    grid = GridMap(occupied)
    found = k_shortest(grid, (0, 0), (2, 2), 5)
    assert len(found) == 2  # once around either side, no diagonal past the corner
    for path in found:
        validate(grid, path, (0, 0), (2, 2))
        assert path_length(path) == 4
    assert path_length(k_shortest(GridMap(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2), 1)[0]) == 2 * math.sqrt(2)


def test_wrong_options_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="layout"):
        Traffic(out=tmp_path, maps=("nowhere",), pictures=False).run()
    with pytest.raises(ConfigError, match="runs=0"):
        Traffic(out=tmp_path, runs=0).run()
    assert not list(tmp_path.iterdir())


def test_pieces_of_work() -> None:
    pieces = Traffic(runs=3).pieces(("narrow",))
    assert len(pieces) == len(set(pieces)) == 3 + 6 + 10
