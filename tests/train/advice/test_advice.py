"""Test advice: changes by hand, texts, the command, and pages of halls."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.maps.halls.test_map_server import REAL, YAML, hall, room
from tests.train.advice.floors import RACKS, floor_of
from train.advice import changes
from train.advice.advice_page import FOLDER, advice_page, doubts, hall_parts, recommended, with_parameter, write_floor
from train.advice.answer import Advice, answer
from train.advice.capacity import Capacity, RobotsNeeded
from train.advice.changes import Candidate, Effect, aisles, choose
from train.advice.curve import LoadPoint
from train.advice.study import Team
from train.advice.trials import AdvicePlan
from train.advice.trips import Bottleneck, expected_cost
from train.cli import main
from train.evaluation.places import FloorNotes
from train.reporting.rows import Interval, read_rows
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.hall import read_hall
from warehouse_env.maps.layouts import make_layout
from warehouse_env.maps.movingai import write_map
from warehouse_env.render.heat_maps import cell_kinds, hall_map


def test_aisles_open_gaps_faces_and_whole_lines() -> None:
    found = {one.text: one for one in aisles(RACKS, (3, 2))}
    north = [text for text in found if "y 4" in text or "y 5" in text]
    assert "a gap through the shelves at x 2 to 3 m, y 4 to 6 m (2 shelf cells)" in north
    assert "the aisle wider by a row of shelves at x 1 to 5 m, y 4 to 5 m (4 shelf cells)" in north
    line = found["a new aisle at x 2 to 3 m, y 1 to 6 m (4 shelf cells)"]
    assert np.argwhere(line.opened).tolist() == [[1, 2], [2, 2], [4, 2], [5, 2]]
    assert not line.grid.occupied[line.opened].any()
    assert line.grid.occupied.sum() == RACKS.occupied.sum() - 4
    for one in found.values():
        assert one.grid.endpoints == RACKS.endpoints


def test_racks_beside_a_crossing_can_be_opened() -> None:
    hall = floor_of(".......", ".##.##.", ".......", ".##.##.", ".......")
    found = {tuple(map(tuple, np.argwhere(one.opened).tolist())) for one in aisles(hall, (2, 3))}
    assert ((1, 1), (1, 2), (1, 4), (1, 5)) in found  # a west-east line through the racks to the north
    assert ((1, 2), (3, 2)) in found  # a north-south line through the racks to the west


def test_walls_are_never_opened() -> None:
    walled = floor_of("########", "#......#", "#.####.#", "#......#", "########")
    opened = np.any([one.opened for one in aisles(walled, (1, 3))], axis=0)
    assert np.argwhere(opened).tolist() == [[2, 2], [2, 3], [2, 4], [2, 5]]
    assert aisles(floor_of("......", "......"), (0, 2)) == []


def test_changes_are_chosen_by_expected_trip_cost() -> None:
    trips = [((0, 2), (6, 2)), ((6, 3), (0, 3))]
    # A new aisle makes a straight trip of 6 cells; the way around the racks is longer.
    line = next(one for one in aisles(RACKS, (3, 2)) if one.text.startswith("a new aisle at x 2"))
    face = next(one for one in aisles(RACKS, (3, 2)) if one.text.startswith("the aisle wider by"))
    assert expected_cost(line.grid, trips[:1], 0) == 6.0
    assert expected_cost(RACKS, trips[:1], 0) > 6.0
    assert choose([face, line, line], trips, 0, 5) == [line, face]
    assert choose([face, line], trips, 0, 1) == [line]


def interval(mean: float, half: float = 0.0, samples: int = 8) -> Interval:
    return Interval(mean, mean - half, mean + half, samples)


def load(robots: int, goals: Interval, stuck: float = 0.0, jammed: bool = False) -> LoadPoint:
    return LoadPoint(robots, goals.samples, goals, goals.times(1 / robots), interval(stuck, 0.1), interval(0.1), jammed)


SIXTEEN, TWENTY, JAM = load(16, interval(1000.0, 100.0)), load(24, interval(1010.0, 100.0)), load(
    32, interval(500.0, 50.0), 0.5, True)  # fmt: skip
CAPACITY = Capacity(
    Team("shielded", 16), load(16, interval(990.0, 50.0)), interval(125.0, 5.0), [SIXTEEN, TWENTY, JAM], True,
    interval(0.0), interval(12.0, 2.0), JAM, [], "",
)  # fmt: skip


def advice(asked: RobotsNeeded | None = None, **changes: Any) -> Advice:
    """Return advice: sixteen robots reach the most goals, 32 jam, one more aisle gains."""
    base = interval(1000.0, 100.0)
    effect = Effect(aisles(RACKS, (3, 2))[0], 4, base, interval(50.0, 10.0))
    plan = AdvicePlan(RACKS, ("greedy", "shielded"), "astar_turns", 300.0, 0, None, 64)
    floor = FloorNotes(np.ones((7, 6)), np.empty((0, 2)), 1.0)
    worst = [Bottleneck((3, 3), 3.5, 3.5, 30.0, 0.75, 0.25)]
    known = Advice(plan, CAPACITY.team, CAPACITY, asked, floor, worst, np.zeros((7, 6)), effect, True, {})
    return known._replace(**changes)


def answer_with(**changes: Any) -> str:
    return "\n".join(answer(advice(capacity=CAPACITY._replace(**changes))))


def test_answer_states_the_findings() -> None:
    text = "\n".join(answer(advice(RobotsNeeded(900.0, 12, interval(950.0, 40.0)))))
    for part in (
        "900 goals an hour take 12 robots", "950 [910, 990]",
        "the most with 16 robots: 990 [940, 1,040] goals an hour",
        "about 12 [10, 14] robots on",
        "With 32 robots it jams", "50.0 [40.0, 60.0]% of the robots are stuck",
        "`shielded`, the best of 2 policies",
        "wait most at **1** (x 3.5 m, y 3.5 m; 75% of all waiting",
        "the best of 4 tried is a gap through the shelves",
        "it gains +50.0 [40.0, 60.0] goals an hour (+5.0%) in 8 pairs of episodes; it costs",
    ):  # fmt: skip
        assert part in text
    effect = advice().effect
    assert effect is not None
    unsure = answer(advice(effect=effect._replace(gain=interval(5.0, 35.0))))
    assert "the difference may be chance, +5.0" in "\n".join(unsure)


def test_answer_names_the_longest_standing_robot() -> None:
    stood = {"longest_standing_s": 93.2, "seed": 7, "longest_standing_why": "robot 3 waits for 5, which is parked"}
    longest = " The longest stand took 93 s (seed 7): robot 3 waits for 5, which is parked."
    wait, jam = (
        next(part for part in answer(advice(stands={robots: stood})) if words in part)
        for robots, words in ((16, "wait most"), (32, "it jams"))
    )
    assert wait.endswith(longest)
    assert jam.endswith(longest)
    assert longest not in "\n".join(answer(advice(stands={8: stood})))


def test_answer_states_missing_findings() -> None:
    text = answer_with(jam=None, knee=None, loads=[SIXTEEN], raced=False, stopped=["32 robots were tried", "all"])
    for part in ("No jam was seen with up to 16", "Up to 16 robots, each adds over half", "at least this with 16",
                 "The time was over before 32 robots were tried, all.", "The policy is `shielded`."):  # fmt: skip
        assert part in text
    assert "[10, more than were tried] robots on" in answer_with(knee=Interval(12.0, 10.0, math.inf, 8))
    assert "0.500 [0.400, 0.600] contacts" in answer_with(contacts=interval(0.5, 0.1))
    assert "less than 90% of what 24 reach" in answer_with(jam=JAM._replace(stuck=interval(0.0)))
    assert "**One more aisle**: there was no time to try any." in answer(advice(effect=None, sought=False))
    assert "No robot waited, so there is no bottleneck." in answer(advice(bottlenecks=[], effect=None))


COMMON = ["advise", "--episodes", "2", "--seconds", "20", "--most", "6", "--processes", "1", "--policy", "greedy"]


def test_advise_drives_answers_and_writes_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(changes, "SOUGHT", 1)
    racks = ["..............", *[".####..####..."] * 2] * 4
    write_map(floor_of(*racks, ".............."), tmp_path / "hall.map")
    command = [*COMMON, "--goals", "1", "--map", str(tmp_path / "hall.map"), "--out", str(tmp_path)]
    assert main(command) == 0
    printed = capsys.readouterr().out
    page = (tmp_path / "index.html").read_text()
    rows = read_rows(tmp_path / "rows.jsonl")
    assert f"wrote {len(rows)} rows to {tmp_path / 'rows.jsonl'} and the page to {tmp_path / 'index.html'}" in printed
    assert {row["robots"] for row in rows if row["floor"] == "as it is"} >= {1, 2, 4}
    assert "1 goals an hour" in printed
    assert "<b>hall reaches " in page
    driven = "Driven with traffic rules; planner astar_turns; decision interval 0.1 s. "
    assert printed.count(driven) == page.count(driven) == 2  # in the parts on robots and bottlenecks
    assert "<h2>What a change gains</h2>" in page
    changed = [row for row in rows if row["floor"] != "as it is"]
    assert len(changed) == 2  # two episodes of one change, without a race
    pairs = {(row["seed"], row["robots"]) for row in rows if row["floor"] == "as it is"}
    assert {(row["seed"], row["robots"]) for row in changed} <= pairs

    assert main([*command, "--resume"]) == 0
    assert read_rows(tmp_path / "rows.jsonl") == rows
    again = (tmp_path / "index.html").read_text()
    assert again.split("<h2>What was run")[0] == page.split("<h2>What was run")[0]


SCHEMA = REAL / "LIF-1.0.0.schema.json"


def test_cell_kinds_by_hand(tmp_path: Path) -> None:
    """Classify cells of 4 x 4 pixels: with a speck, part of a wall, a wall, cut off, and barred by a mask."""
    pytest.importorskip("matplotlib")
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


def test_doubts_state_their_remedy(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
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


def changed(grid: GridMap, gain: float) -> Any:
    """Return advice whose best change, an aisle if one can be opened, gains `gain` goals/h."""
    gap = next(iter(aisles(grid, (3, 2))), Candidate("nothing", grid, np.zeros(grid.shape, dtype=np.bool_)))
    effect = Effect(gap, 1, interval(1.0), interval(gain, 5.0))
    return advice(effect=effect, plan=AdvicePlan(grid, ("greedy",), "astar", 300.0, 7, None, 8))


def test_significant_gain_is_recommended() -> None:
    known = changed(RACKS, 50.0)
    assert recommended(known) is known.effect
    for unsure in (changed(RACKS, 4.0), changed(RACKS, -50.0), advice(effect=None)):
        assert recommended(unsure) is None


@pytest.mark.parametrize("name", ["racks", "depot"])
def test_floor_files_of_the_advice_round_trip(name: str, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
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
