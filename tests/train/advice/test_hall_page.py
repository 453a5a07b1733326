"""An advice on a hall: doubts about its map, its picture, and the floor to take away."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.maps.halls.test_map_server import REAL, YAML, hall, room
from tests.train.advice.floors import RACKS
from tests.train.advice.test_advice import advice, interval
from train.advice.advice_page import FOLDER, advice_page, recommended, write_floor
from train.advice.candidates import Candidate, alternating
from train.advice.changes import Effect
from train.advice.hall_part import doubts, hall_parts, with_parameter
from train.advice.trials import AdvicePlan
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.hall import read_hall
from warehouse_env.maps.layouts import make_layout
from warehouse_env.render.hall_map import cell_kinds, hall_map

pytest.importorskip("matplotlib")
SCHEMA = REAL / "LIF-1.0.0.schema.json"


def test_kinds_of_cells_by_hand(tmp_path: Path) -> None:
    """Cells of 4 x 4 pixels: a speck, a wall in part and wholly, a cell that is cut off, one that a mask bars."""
    grey = room(12, 20)
    grey[0, 0] = 0  # a sixteenth of cell (0, 0)
    grey[0:2, 4:8] = 0  # half of cell (0, 1)
    grey[0:4, 8:12] = 0
    grey[8:12, 12:16] = grey[4:8, 16:20] = 0  # around cell (2, 4)
    text = YAML.replace("0.5\n", "0.25\n", 1)
    mask = np.full(grey.shape, 254)
    mask[8:12, 0:4] = 0
    hall(tmp_path, mask, text)
    for end in ("yaml", "pgm"):
        (tmp_path / f"hall.{end}").rename(tmp_path / f"hall_keepout.{end}")
    keepout = tmp_path / "hall_keepout.yaml"
    keepout.write_text(keepout.read_text().replace("hall.pgm", "hall_keepout.pgm"))
    name = f"{hall(tmp_path, grey, text)}:share=0.1,keepout=hall_keepout.yaml"
    assert cell_kinds(read_hall(name)).tolist() == [[1, 4, -1, 0, 0], [0, 0, 0, 0, -1], [2, 0, 0, -1, 3]]
    drawing = hall_map(read_hall(name), "label")
    for key in ("driven on, though something small stands there", "cut off", "closed by a mask or off the lanes"):
        assert key in drawing
    assert "unknown to the map" not in drawing


def test_what_is_doubtful_is_said_with_what_settles_it(tmp_path: Path) -> None:
    grey = room(12, 20)
    grey[0, 0] = 0
    name = f"{hall(tmp_path, grey)}:share=0.3"
    guessed, small, *_ = doubts(read_hall(name), name)
    assert guessed.startswith("pick faces and stations are guessed: ")
    assert small.startswith("1 cell that robots drive on hold")
    assert "`hall.yaml:share=0` closes" in small
    understood, doubtful = hall_parts(read_hall(name), name)
    assert understood.points[0].startswith("Pixels of 0.5 m: 1 occupied, 239 free, 0 unknown.")
    assert doubtful.points[0].startswith("Pick faces and stations")
    assert with_parameter("a/hall.yaml:cell=0.75,share=0.3", "share=0") == "hall.yaml:cell=0.75,share=0"


def changed(grid: GridMap, *gains: float) -> Any:
    """Return an advice on a floor of which its one-way rules, if there are any, and another change bring so much."""
    nothing = np.zeros(grid.shape, dtype=np.bool_)
    found = [*alternating(grid)[:1], Candidate("aisle", "nothing", grid, nothing)]
    effects = [
        Effect(candidate, 1, interval(1.0), interval(gain, 5.0)) for candidate, gain in zip(found, gains, strict=False)
    ]
    return advice(effects=effects, plan=AdvicePlan(grid, ("greedy",), "astar", 300.0, 7, None, 8))


def test_the_change_that_is_told_to_bring_most_is_recommended() -> None:
    for gains, best in (((50.0, 40.0), 0), ((50.0, 60.0), 1)):
        known = changed(RACKS, *gains)
        assert recommended(known) is known.effects[best]
    for unsure in (changed(RACKS, 4.0), changed(RACKS, -50.0), changed(RACKS)):
        assert recommended(unsure) is None


@pytest.mark.parametrize("name", ["racks", "depot"])
def test_files_to_take_away_are_read_back_to_the_same_floor(name: str, tmp_path: Path) -> None:
    if name == "depot" and not REAL.exists():
        pytest.skip("the real halls are not here")
    racks = dataclasses.replace(RACKS, origin=(-3.5, 2.25))
    grid = racks if name == "racks" else make_layout(str(REAL / f"{name}.yaml"))
    known = changed(grid, 50.0)
    links = write_floor(known, tmp_path)
    assert [link.title for link in links] == ["Map", "Lanes as LIF 1.0.0", "Lanes for Nav2"]
    assert all((tmp_path / link.target).is_file() for link in links)
    best = recommended(known)
    found = grid if best is None else best.candidate.grid
    (path,) = (tmp_path / FOLDER).glob("*.yaml")
    read = make_layout(str(path))
    assert (read.one_way[tuple(found.free_cells.T)] == found.one_way[tuple(found.free_cells.T)]).all()
    assert read.endpoints == found.endpoints
    if SCHEMA.exists():
        validate = pytest.importorskip("jsonschema").validate
        validate(json.loads(next((tmp_path / FOLDER).glob("*.lif.json")).read_text()), json.loads(SCHEMA.read_text()))
    page = advice_page(known, files=links).html()
    assert "The floor to take away" in page
