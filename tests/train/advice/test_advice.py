"""Advice: the number of robots, bottlenecks and changes worked out by hand, its words, and the command for real."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from train.advice import course
from train.advice.answer import answer, worthwhile
from train.advice.candidates import (
    EAST,
    WEST,
    Bottleneck,
    aisle_cells,
    aisles,
    alternating,
    bottlenecks,
    choose,
    cut_off,
    expected_cost,
    one_ways,
    passing,
    traffic,
)
from train.advice.course import FEWEST, MOST, Advice, Effect, Load, Plan, bears, loads, next_count
from train.advice.trials import Clock, Trial
from train.cli import main
from train.evaluation.jobs import Result, Runner, Tick
from train.evaluation.places import Floor
from train.reporting.rows import Interval, RowFile, read_rows
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.movingai import EXAMPLE_MAP

NAN = math.nan


def floor_of(*lines: str, **more: Any) -> GridMap:
    return GridMap(np.array([[letter == "#" for letter in line] for line in lines]), name="hall", **more)


# Two racks of 2 x 4 cells, an aisle of one cell between them, ways of one cell around.
RACKS = floor_of(
    "......",
    ".####.",
    ".####.",
    "......",
    ".####.",
    ".####.",
    "......",
    picks=[(3, 2), (0, 2)],
    stations=[(0, 0), (6, 5)],
)


def driven(late: float, stuck: float = 0.0) -> dict[str, Any]:
    return {"late_goals_per_robot_hour": late, "stuck": stuck, "waiting_share": 0.1}


def test_a_floor_jams_where_robots_are_stuck_or_all_together_do_less() -> None:
    found = loads({16: [driven(100.0), driven(110.0)], 8: [driven(120.0)], 32: [driven(40.0)], 24: [driven(90, 0.06)]})
    assert [(load.robots, load.goals.mean, load.jammed) for load in found] == [
        (8, 960.0, False), (16, 1680.0, False), (24, 2160.0, True), (32, 1280.0, True),
    ]  # fmt: skip
    assert found[1].goals.high == pytest.approx(1680 + 16 * 12.7062 * 5)  # t of one degree, deviation 7.07 / sqrt(2)
    assert bears(found) == 16


def tried(*robots: tuple[int, bool]) -> list[Load]:
    none = Interval(NAN, NAN, NAN, 0)
    return [Load(count, 1, none, none, none, none, jammed) for count, jammed in sorted(robots)]


def test_robots_double_until_they_jam_then_the_gap_is_halved() -> None:
    assert next_count([], 512) == 8
    assert next_count([], 5) == 5
    assert next_count(tried((8, False)), 512) == 16
    assert next_count(tried((8, False), (16, False)), 20) == 20
    assert next_count(tried((8, False), (20, False)), 20) is None
    assert next_count(tried((32, False), (64, True)), 512) == 48
    assert next_count(tried((32, False), (48, True), (64, True)), 512) == 40
    assert next_count(tried((40, False), (45, True)), 512) is None  # within an eighth
    assert next_count(tried((8, True)), 512) == 4
    assert next_count(tried((1, True), (8, True)), 512) is None
    assert bears(tried((8, False), (16, True), (12, False), (32, False))) == 12
    assert bears(tried((8, True))) == 0


def test_a_further_robot_is_worth_half_of_one_alone() -> None:
    def load(robots: int, goals: float) -> Load:
        return tried((robots, False))[0]._replace(goals=Interval(goals, NAN, NAN, 1))

    ladder = [load(8, 800.0), load(16, 1500.0), load(32, 2200.0), load(64, 2300.0)]
    assert worthwhile(ladder, 100.0) == 16  # from 16 to 32 robots each brings 44
    assert worthwhile(ladder[:2], 100.0) is None
    assert worthwhile([load(8, 300.0)], 100.0) is None


def test_traffic_of_two_routes_by_hand() -> None:
    routes = [np.array([(0, 0), (0, 1), (1, 2)]), np.array([(0, 1), (0, 0)])]
    flow, visits = traffic(routes, (2, 3)), passing(routes, (2, 3))
    assert flow[0, 0, 0] == 0.5  # east
    assert flow[0, 1, 7] == 0.5  # south-east
    assert flow[0, 1, 4] == 0.5  # west
    assert flow.sum() == 1.5
    assert visits.tolist() == [[1.0, 1.0, 0.0], [0.0, 0.0, 0.5]]


def test_bottlenecks_say_where_in_metres_and_how_much() -> None:
    waiting = np.zeros((7, 6))
    waiting[3, 3], waiting[6, 0] = 30.0, 10.0
    visits = np.zeros((7, 6))
    visits[3, 4] = 0.25
    first, second = bottlenecks(RACKS, waiting, visits)
    assert first == Bottleneck((3, 3), 3.5, 3.5, 30.0, 0.75, 0.25)
    assert second[:4] == ((6, 0), 0.5, 0.5, 10.0)


def test_aisles_open_gaps_faces_and_whole_lines() -> None:
    found = {one.text: one for one in aisles(RACKS, (3, 2))}
    north = [text for text in found if "y 4" in text or "y 5" in text]
    assert "a gap through the shelves at x 2 to 3 m, y 4 to 6 m (2 shelf cells)" in north
    assert "the aisle wider by a row of shelves at x 1 to 5 m, y 4 to 5 m (4 shelf cells)" in north
    line = found["a new aisle at x 2 to 3 m, y 1 to 6 m (4 shelf cells)"]
    assert np.argwhere(line.changed).tolist() == [[1, 2], [2, 2], [4, 2], [5, 2]]
    assert not line.grid.occupied[line.changed].any()
    assert line.grid.occupied.sum() == RACKS.occupied.sum() - 4
    for one in found.values():
        assert one.grid.endpoints == RACKS.endpoints


def test_on_a_crossing_the_racks_beside_it_can_be_opened() -> None:
    hall = floor_of(".......", ".##.##.", ".......", ".##.##.", ".......")
    found = {tuple(map(tuple, np.argwhere(one.changed).tolist())) for one in aisles(hall, (2, 3))}
    assert ((1, 1), (1, 2), (1, 4), (1, 5)) in found  # a line west-east through the racks north of it
    assert ((1, 2), (3, 2)) in found  # one north-south through those west of it


def test_a_rack_behind_another_is_not_beside_it() -> None:
    hall = floor_of("......", "..##..", "......", ".#..#.", ".#..#.", "......")
    opened = np.any([one.changed for one in aisles(hall, (4, 0))], axis=0)
    assert np.argwhere(opened).tolist() == [[3, 1], [4, 1], [4, 4]]  # and nothing of the rack north of the next aisle


def test_walls_stay() -> None:
    walled = floor_of("########", "#......#", "#.####.#", "#......#", "########")
    opened = np.any([one.changed for one in aisles(walled, (1, 3))], axis=0)
    assert np.argwhere(opened).tolist() == [[2, 2], [2, 3], [2, 4], [2, 5]]
    assert aisles(floor_of("......", "......"), (0, 2)) == []


def test_aisles_are_narrow_runs() -> None:
    rows = aisle_cells(RACKS, along_row=True)
    assert (rows > 0).tolist() == [[row in (0, 3, 6) and 1 <= column <= 4 for column in range(6)] for row in range(7)]
    columns = aisle_cells(RACKS, along_row=False)
    assert (columns[:, 0] > 0).tolist() == [False] * 7  # runs of two cells between crossings are no aisle
    wide = floor_of("......", "......", "......", "######")
    assert not aisle_cells(wide, along_row=True).any()


def test_one_way_goes_where_most_drive() -> None:
    flow = np.zeros((7, 6, 8))
    flow[3, 2, 4], flow[3, 3, 0] = 0.3, 0.1  # west, east
    (street,) = one_ways(RACKS, (3, 3), flow)
    assert street.text == "one way west at x 1 to 5 m, y 3 to 4 m"
    assert street.grid.one_way[3].tolist() == [0, WEST, WEST, WEST, WEST, 0]
    assert street.grid.one_way.sum() == 4 * WEST
    assert street.grid.endpoints == RACKS.endpoints
    flow[3, 2, 1] = 0.5  # north-east
    assert one_ways(RACKS, (3, 3), flow)[0].grid.one_way[3, 1] == EAST


def test_a_one_way_that_cuts_endpoints_off_is_none() -> None:
    dead_end = floor_of("######", "......", "######", picks=[(1, 5)], stations=[(1, 0)])
    assert cut_off(dead_end) is None
    assert one_ways(dead_end, (1, 2), np.zeros((3, 6, 8))) == []


def test_aisles_in_turn() -> None:
    (both,) = alternating(RACKS)
    assert both.text == "all 3 lines of west-east aisles one way in turn"
    assert [row[2] for row in both.grid.one_way.tolist()] == [EAST, 0, 0, WEST, 0, 0, EAST]


def test_changes_are_chosen_by_what_trips_should_cost() -> None:
    trips = [((0, 2), (6, 2)), ((6, 3), (0, 3))]
    # Straight down is 6 cells of driving where a new aisle is; around the racks it is longer.
    line = next(one for one in aisles(RACKS, (3, 2)) if one.text.startswith("a new aisle at x 2"))
    face = next(one for one in aisles(RACKS, (3, 2)) if one.text.startswith("the aisle wider by"))
    assert expected_cost(line.grid, trips[:1], 0) == 6.0
    assert expected_cost(RACKS, trips[:1], 0) > 6.0
    assert choose([face, line, line], trips, 0, 5) == [line, face]
    assert choose([face, line], trips, 0, 1) == [line]


def test_conflicts_cost_cells() -> None:
    lane = floor_of("......", "######", picks=[(0, 5)], stations=[(0, 0)])
    trips = [((0, 0), (0, 5)), ((0, 5), (0, 0))]
    # 5 cells each. They conflict if they enter within 5 + 1 cells of each other, each once in 5: 6 (1/5 + 1/5) = 2.4.
    assert expected_cost(lane, trips, 2) == pytest.approx(5 + 4 * 2.4)


def test_as_many_changes_as_there_is_time_for() -> None:
    assert course._affordable(math.inf, 1.0) == 3
    assert course._affordable(3 * (2 * 2 + 1 + 2 * 3) * 10.0, 10.0) == 2  # 2 of each kind, the floor, and 3 twice
    assert course._affordable(0.0, 10.0) == 1


def advice(**changes: Any) -> Advice:
    """Sixteen robots drive, 32 jam; one aisle is told apart, one rule is not."""
    sure, unsure = Interval(50.0, 40.0, 60.0, 4), Interval(5.0, -30.0, 40.0, 4)
    base, none = Interval(1000.0, 900.0, 1100.0, 4), Interval(NAN, NAN, NAN, 0)
    (gap, *_), (rule,) = aisles(RACKS, (3, 2)), alternating(RACKS)
    effects = [Effect(gap, sure, base, sure, sure, sure), Effect(rule, sure, base, unsure, none, none)]
    held = Interval(0.1, 0.05, 0.15, 4)
    drives = Load(16, 4, base, Interval(62.5, 60.0, 65.0, 4), Interval(0.0, 0.0, 0.0, 4), held, False)
    jams = drives._replace(robots=32, stuck=Interval(0.5, 0.25, 0.75, 4), jammed=True)
    known = Advice(
        Plan(RACKS, "astar_turns", 300.0, 0, None, 64), Interval(125.0, 120.0, 130.0, 12), [drives, jams], 16, False,
        Floor(np.ones((7, 6)), np.empty((0, 2)), np.empty(0), 1.0), np.zeros((7, 6)),
        [Bottleneck((3, 3), 3.5, 3.5, 30.0, 0.75, 0.25)], effects,
    )  # fmt: skip
    return known._replace(**changes)


def test_the_answer_in_words() -> None:
    robots, places, aisle, rule, _ = answer(advice())
    assert robots.startswith(
        "**hall bears about 16 robots.** With 32 it jams: 50.0 [25.0, 75.0]% of the robots are stuck after 5 minutes. "
        "16 robots together reach 1000 [900, 1100] goals an hour; each of them 50% of what one alone would"
    )
    assert places == "Robots wait most at **1** (x 3.5 m, y 3.5 m; 75% of all waiting, 25% of all trips pass)."
    assert aisle.endswith("it brings +50.0 [40.0, 60.0] goals an hour (+5.0%) in 4 pairs of episodes.")
    assert "*not told apart* from nothing: +5.0 [-30.0, 40.0] goals an hour (+0.5%)" in rule


def test_a_fall_that_may_be_chance_is_called_so() -> None:
    drives, jams = advice().loads
    fewer = jams._replace(stuck=Interval(0.0, 0.0, 0.0, 4), goals=Interval(800.0, 750.0, 850.0, 4))
    (text, *_) = answer(advice(loads=[drives, fewer]))
    assert "less than 90% of what 16 did (difference -200 [-312, -88])." in text  # half widths 50 and 100
    (text, *_) = answer(advice(loads=[drives, fewer._replace(goals=Interval(800.0, 500.0, 1100.0, 4))]))
    assert "(difference -200 [-516, 116]; so few episodes do *not tell* this *apart* from chance)" in text


def test_the_answer_where_nothing_jams_or_all_does() -> None:
    first, second = advice().loads
    (text, *_) = answer(advice(loads=[first]))
    assert text.startswith("**hall bears 16 robots at least**: no jam was seen with up to 16 (the most to try")
    assert "(the time was over)" in answer(advice(loads=[first], stopped=True))[0]
    assert answer(advice(loads=[second], bears=0))[0].startswith("**hall jams with 32 robots already**")
    assert "No robot waited, so there is no bottleneck." in answer(advice(bottlenecks=[], effects=[]))


def never_waiting(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Rows of robots that never wait, of whom a third are stuck from 16 robots on."""
    return [
        {
            "robots": one.robots, "seed": one.seed, "seconds": one.seconds, "shape": list(one.grid.shape),
            "late_goals_per_robot_hour": 100.0, "goals_per_robot_hour": 100.0, "waiting_share": 0.0,
            "stuck": 0.3 * (one.robots >= 16), "waited": [], "contacts": [], "ratios": [1.0],
        }
        for one in trials
    ]  # fmt: skip


@pytest.mark.parametrize("rounds", [9, 1000])
def test_where_nothing_can_be_changed_the_time_goes_to_the_numbers_beside_the_answer(rounds: int) -> None:
    class Counting(Clock):
        asked = 0

        def allows(self, seconds: float, share: float = 1.0) -> bool:
            Counting.asked += 1
            return Counting.asked <= rounds

    hall = floor_of(*["............"] * 10)
    found = course.advise(Plan(hall, "astar", 60.0, 7, None, 24), never_waiting, Counting(5.0))
    assert [load.robots for load in found.loads] == [8, 12, 14, 15, 16]
    assert found.bears == 15
    assert found.effects == []
    episodes = [load.episodes for load in found.loads]
    more = min(rounds - 4, 2 * (MOST - FEWEST))  # four numbers after the first one ask the clock, too
    assert episodes[:3] == [FEWEST] * 3
    assert sum(episodes[3:]) == 2 * FEWEST + more
    assert abs(episodes[3] - episodes[4]) <= 1


COMMON = ["advise", "--episodes", "2", "--seconds", "5", "--most", "9", "--processes", "1", "--seed", "700"]


def test_the_command_drives_and_writes_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(course, "TRIED", 1)
    command = [*COMMON, "--map", str(EXAMPLE_MAP), "--out", str(tmp_path)]
    assert main(command) == 0
    printed = capsys.readouterr().out
    page = (tmp_path / "index.html").read_text()
    rows = read_rows(tmp_path / "rows.jsonl")
    assert f"wrote {len(rows)} rows to {tmp_path / 'rows.jsonl'} and the page to {tmp_path / 'index.html'}" in printed
    assert {(row["floor"], row["robots"]) for row in rows} >= {("as it is", 1), ("as it is", 8), ("as it is", 9)}
    assert "warehouse-40-64 bears 9 robots at least" in printed
    assert "<b>warehouse-40-64 bears 9 robots at least</b>" in page
    assert "<h2>What a change would bring</h2>" in page
    changed = [row for row in rows if row["floor"] != "as it is"]
    assert len(changed) % 4 == 0  # two at first look, two measured, of each kind that there is
    pairs = {(row["seed"], row["robots"]) for row in rows if row["floor"] == "as it is"}
    assert {(row["seed"], row["robots"]) for row in changed} <= pairs

    assert main([*command, "--resume"]) == 0
    assert read_rows(tmp_path / "rows.jsonl") == rows
    again = (tmp_path / "index.html").read_text()
    assert again.split("<h2>What was run")[0] == page.split("<h2>What was run")[0]


def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stops(trial: Trial, tick: Tick) -> Result:
        if trial.robots > 1:
            raise KeyboardInterrupt
        return drives(trial, tick)

    drives = Trial.run
    monkeypatch.setattr(Trial, "run", stops)
    assert main([*COMMON, "--layout", "open", "--out", str(tmp_path)]) == 130
    rows = tmp_path / "rows.jsonl"
    error = capsys.readouterr().err
    assert error == f"warehouse: stopped; 8 rows are kept in {rows}; the same command with --resume goes on\n"
    assert len(read_rows(rows)) == 8


def test_known_trials_are_not_driven_again() -> None:
    asked = [Trial("as it is", RACKS, 1, seed, 5.0, "astar") for seed in (1, 2)]
    done = [{**trial.identity, "goals": seed} for trial, seed in zip(asked, (1, 2), strict=True)]
    with Runner(RowFile(None), done) as drive:
        assert [row["goals"] for row in drive(asked[::-1])] == [2, 1]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ("", "name one floor: --map FILE or --layout NAME"),
        ("--layout narrow --map x.map", "name one floor"),
        ("--layout nowhere", "unknown layout 'nowhere'"),
        ("--map nowhere.map", "does not exist"),
        ("--layout open --minutes 0", "minutes=0.0 must be a number from 0.01"),
        ("--layout open --episodes 1", "episodes=1 must be a whole number from 2"),
        ("--layout open --planner nobody", "unknown planner 'nobody'"),
    ],
)
def test_bad_input_is_one_sentence(
    options: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["advise", *options.split(), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
