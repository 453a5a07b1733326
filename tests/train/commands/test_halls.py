"""Test halls on the command line: written, drawn, converted, edited, driven; losses are one-line notes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from train import cli
from train.cli import main
from warehouse_env.config import EnvConfig
from warehouse_env.errors import MapWarning
from warehouse_env.maps.halls.hall import read_hall
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator


def run(*words: str) -> int:
    return main(list(words))


@pytest.fixture
def hall(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    path = tmp_path / "hall.yaml"
    assert run("layouts", "--draw", "aisles:seed=7", "--save", str(path), "--resolution", "0.25") == 0
    assert f"wrote {path}, which is read by --map {path}" in capsys.readouterr().out
    return path


def test_layout_round_trips_as_a_hall(hall: Path) -> None:
    assert make_layout(str(hall)).key == make_layout("aisles:seed=7").key


def test_hall_is_drawn_checked_and_converted(hall: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("layouts", "--draw", f"{hall}:cell=0.5", "--png", str(hall.with_suffix(".png"))) == 0
    shown = capsys.readouterr().out
    assert "cells of 0.5 m" in shown
    assert "is good" in shown
    for name in ("h.map", "h.lif.json", "h.geojson"):
        assert run("layouts", "--draw", str(hall), "--save", str(hall.parent / name)) == 0
    both = hall.parent / "both.png", hall.parent / "h.building.yaml"
    assert run("layouts", "--draw", str(hall), "--png", str(both[0]), "--save", str(both[1])) == 0
    assert both[0].exists()
    with Image.open(both[1].with_suffix(".png")) as drawing:  # pixels of 5 cm, so that people recognise the floor
        assert drawing.size == tuple(20 * side for side in read_hall(str(hall)).grid.shape[::-1])
    assert run("layouts", "--draw", str(hall), "--save", "h.txt") == 2
    assert "must end in .map, .yaml, .lif.json, .geojson or .building.yaml" in capsys.readouterr().err


def test_places_are_written_once_and_edited(hall: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = hall.with_suffix(".places.json")
    file.unlink()
    assert run("places", str(hall)) == 0
    assert f"picks and {len(read_hall(str(hall)).grid.stations)} stations to {file}" in capsys.readouterr().out
    places = json.loads(file.read_text())
    del places["picks"][0]
    file.write_text(json.dumps(places))
    assert run("places", str(hall)) == 0
    assert "read " in capsys.readouterr().out
    assert [place.name for place in read_hall(str(hall)).places["picks"]][:2] == ["2", "3"]
    assert json.loads(file.read_text()) == places
    assert run("places", str(hall), "--propose") == 0
    assert len(json.loads(file.read_text())["picks"]) == len(places["picks"]) + 1


def test_lost_places_are_a_one_line_note(hall: Path, tmp_path: Path) -> None:
    (hall.with_suffix(".places.json")).write_text('{"picks": [{"x": 2.5, "y": 2.5}, {"x": -99, "y": 0}]}')
    with pytest.warns(MapWarning, match="1 of 2 picks are on no floor") as warned:
        run(
            "plan", "--map", str(hall), "--tasks", "1", "--planner", "astar", "--no-pictures", "--out", str(hall.parent)
        )
    shown = cli._notes()
    assert shown(warned[0].message, MapWarning, "x.py", 3).startswith("warehouse: note: hall: 1 of 2 picks")
    assert shown(warned[0].message, MapWarning, "y.py", 4) == ""  # the note appears only once
    assert "\n" not in str(warned[0].message)


def test_recording_keeps_the_floors_origin(hall: Path, tmp_path: Path) -> None:
    hall.write_text(hall.read_text().replace("[0.0, 0.0, 0.0]", "[-15.1, 2.0, 0.0]"))
    hall.with_suffix(".places.json").unlink()
    config = EnvConfig(layout=str(hall), num_agents=2, planner="astar")
    recorder = Recorder(Simulator(config), (31_000_000,))
    recorder.step(np.zeros((1, 2), np.int64))
    recorder.episode.save(tmp_path / "e.npz")
    assert Episode.load(tmp_path / "e.npz").grid.origin == (-15.1, 2.0)
