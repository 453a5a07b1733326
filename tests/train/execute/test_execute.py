"""Test plans of grid planners: reading, checks, motions, order, and driving without contact."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.train.execute.floors import BLOCK, OPEN, curves_on, random_walk
from train.cli import main
from train.execute.conflicts import NONE, sweeps_any
from train.execute.drive import Drive
from train.execute.lifelong import Pibt, add_grid_planner, plan_lifelong
from train.execute.motions import DIRECTIONS, Curves, motions_of
from train.execute.order import Order, find_order, why_stuck
from train.execute.plan import GridPlan, check_plan, finished, path_of
from train.execute.read import read_plan
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, PlanError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.record.recording import Episode
from warehouse_env.simulation.simulator import Simulator

CELLS = np.array([[(1, 1), (3, 3)], [(1, 2), (3, 3)], [(1, 2), (2, 3)]])  # two robots, two steps
LEAGUE = {"start": [[1, 1, "E"], [3, 3, "E"]], "actualPaths": ["F,W,W", "C,F,W"]}


def _config(robots: int) -> EnvConfig:
    return EnvConfig(num_agents=robots, action_type="raw", planner="astar_turns", max_steps=10_000)


def _driven(order: Order, curves, robots: int, steps: int = 6_000, late: float = 0.0) -> Drive:
    drive, rng = Drive(order, curves, _config(robots)), np.random.default_rng(0)
    for _ in range(steps):
        if drive.over:
            break
        drive.step(rng.random(robots) < late)
    return drive


@pytest.mark.parametrize(
    "text",
    [
        "agents=2\nsolution=\n0:(1,1),(3,3),\n1:(2,1),(3,3),\n2:(2,1),(3,2),\n",  # x, y
        "Agent 0: (1,1)->(1,2)->(1,2)->\nAgent 1: (3,3)->(3,3)->(2,3)->\n",  # row, column
        "Agent 0:(1,1,0)->(1,2,1)->\nAgent 1:(3,3,0)->(3,3,1)->(2,3,2)->\n",  # with the steps
    ],
)
def test_formats_by_step_and_by_robot_give_the_same_plan(tmp_path: Path, text: str) -> None:
    path = tmp_path / "plan.txt"
    path.write_text(text)
    plan = read_plan(path, OPEN)
    np.testing.assert_array_equal(plan.cells, CELLS)
    assert plan.tasks == ((1,), (2,))
    assert plan.makespan == 2


def test_league_actions_turn_on_the_spot(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(LEAGUE))
    plan = read_plan(path, OPEN)
    np.testing.assert_array_equal(plan.cells[:, 0], [(1, 1), (1, 2), (1, 2), (1, 2)])
    np.testing.assert_array_equal(plan.cells[:, 1], [(3, 3), (3, 3), (2, 3), (2, 3)])  # turned left to the north
    path.write_text(json.dumps(LEAGUE | {"events": [[1, 0, 7, 1], [2, 0, 8, 1], [3, 1, 9, 1]]}))
    assert read_plan(path, OPEN).tasks == ((1, 2), (3,))
    earlier = [[[7, 0, "assigned"], [7, 1, "finished"]], [[9, 0, "assigned"], [9, 2, "finished"]]]
    path.write_text(json.dumps(LEAGUE | {"events": earlier}))
    assert read_plan(path, OPEN).tasks == ((1,), (2,))


def test_league_action_runs_take_several_ticks(tmp_path: Path) -> None:
    paths = ["[(0,1,1,0,0):(W 1,F 3)][(4,1,2,0,0):(R 3,F 2)]", "[(0,3,3,0,0):(C 3,W 1,F 1)][(5,3,3,3,1):(W 1,F 2,W 1)]"]
    data = {"start": [[1, 1, "E"], [3, 3, "E"]], "actualPaths": paths, "agentMaxCounter": 3, "version": "2026 LoRR"}
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(data | {"events": [[4, 0, 5, 1], [8, 1, 6, 1]]}))
    plan = read_plan(path, OPEN)
    np.testing.assert_array_equal(plan.cells[:, 0], [(1, 1)] * 4 + [(1, 2)] * 6)
    np.testing.assert_array_equal(plan.cells[:, 1], [(3, 3)] * 8 + [(2, 3)] * 2)  # delayed within a move
    assert (plan.ticks, plan.tasks) == (3, ((4,), (8,)))
    for changes, message in (
        ({"actualPaths": ["[(0,1,1,0,0):(F 3"] * 2}, "without `start` and `actualPaths`"),
        ({"actualPaths": ["[(0,1,1,0,0):(X 3)]"] * 2}, "without `start` and `actualPaths`"),
        ({"agentMaxCounter": 0}, "without `start` and `actualPaths`"),
        ({"actualPaths": [f"[(0,1,1,0,0):({','.join(['W 9999999'] * 20)})]"] * 2}, "more than 100,000,000 actions"),
    ):
        path.write_text(json.dumps(data | changes))
        with pytest.raises(PlanError, match=message):
            read_plan(path, OPEN)


def test_other_formats_may_name_a_path_and_refuse_scenarios(tmp_path: Path) -> None:
    path = tmp_path / "plan.txt"
    path.write_text("map_file=a/path/open.map,seed=1\n0:(1,1),\n1:(2,1),\n")
    assert read_plan(path, OPEN).makespan == 1
    with pytest.raises(PlanError, match="leave out --scen"):
        read_plan(path, OPEN, tmp_path / "two.scen")


def test_tracker_plan_may_be_long(tmp_path: Path) -> None:
    """The plan exceeds the default field limit of Python's csv module, 131,072 characters."""
    path, scen = tmp_path / "plan.csv", tmp_path / "one.scen"
    scen.write_text("version 1\n0\topen.map\t12\t12\t1\t1\t2\t1\t1\n")
    path.write_text(f"agents,path\n1,{'w' * 200_000}r\n")
    assert read_plan(path, OPEN, scen).makespan == 200_001


@pytest.mark.parametrize("moves", ["rw\nwd", "rw\nwu"])  # rows upwards, as published, and downwards
def test_tracker_moves_lead_from_starts_to_goals(tmp_path: Path, moves: str) -> None:
    path, scen = tmp_path / "plan.csv", tmp_path / "two.scen"
    lines = ("1 1 2 1", "3 3 3 2", "9 9 9 9")  # x and y of starts and goals
    scen.write_text("version 1\n" + "".join(f"0\topen.map\t12\t12\t{line.replace(' ', chr(9))}\t1\n" for line in lines))
    path.write_text(f'map_name,agents,solution_plan\nopen,2,"{moves}"\n')
    np.testing.assert_array_equal(read_plan(path, OPEN, scen).cells, CELLS)
    for text, starts, message in (
        (f'agents,path\n2,"{moves}"\n', None, "name their scenarios with --scen"),
        ("agents,path\n1,r\n1,r\n", scen, "holds 2 plans"),
        ("agents,path\n1,rx\n", scen, "robot 0 makes the move 'x'"),
        ("agents,path\n1,l\n", scen, "do not lead the robots"),
        ('agents,path\n4,"r\nw\nw\nw"\n', scen, "has moves of 4 robots"),
    ):
        path.write_text(text)
        with pytest.raises(PlanError, match=message):
            read_plan(path, OPEN, starts)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing", "is no plan"),
        ("0:(1,1),\n2:(1,1),\n", "numbered from 0 on"),
        ("Agent 1: (1,1)->\n", "numbered from 0 on"),
        ("0:(1,1),\n1:(1,2),\n2:(1,\n", "line 3: '2:(1,' is neither a step nor a robot's path"),
        ("Agent 0: (1,1)->(1,2)->(1\n", "line 1: "),
        ("Agent 0:(1,1,0)->(1,2,2)->\n", "must follow each other"),
        ("0:(1,1),(1,1),\n", "step 0: robots 0 and 1 are both at (1, 1)"),
        ("0:(1,1),(2,1),\n1:(2,1),(1,1),\n", "step 1: robots 0 and 1 swap cells"),
        ("0:(1,1),\n1:(3,1),\n", "moves from (1, 1) to (1, 3), which is not beside it"),
        ("0:(99,1),\n", "is at (1, 99), which is no free cell"),
        ('{"start": []}', "without `start` and `actualPaths`"),
        ('{"start": [[1, 1, "X"]], "actualPaths": ["F"]}', "without `start` and `actualPaths`"),
    ],
)
def test_invalid_plan_is_refused_in_one_sentence(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "plan.txt"
    path.write_text(text)
    with pytest.raises(PlanError, match="plan") as error:
        read_plan(path, OPEN)
    assert message in str(error.value)


@given(st.integers(0, 2**32 - 1), st.integers(1, 25))
def test_motions_join_the_cells_of_any_path(seed: int, moves: int) -> None:
    curves = curves_on(BLOCK)
    cells = random_walk(BLOCK, np.random.default_rng(seed), moves)
    motions = motions_of(cells, curves)
    assert [motion.leaves for motion in motions] == list(range(moves))
    for motion, after in pairwise(motions):
        x, y, heading = np.array(curves.end(motion.start, motion.arcs)) - after.start
        assert max(abs(x), abs(y), abs(math.remainder(heading, math.tau))) < 2e-3
    x, y, heading = curves.end(motions[-1].start, motions[-1].arcs)
    ahead = curves.robot.rear_reach - curves.robot.length / 2  # the footprint's centre is the cell's
    middle = x - ahead * math.cos(heading), y - ahead * math.sin(heading)
    np.testing.assert_allclose(middle, BLOCK.centre(np.array(cells[-1])), atol=2e-3)


def test_straight_path_is_driven_forwards_and_back_in_reverse() -> None:
    curves, row = curves_on(OPEN), [(5, column) for column in range(2, 7)]
    there = motions_of(row, curves)
    assert all(motion.arcs.tolist() == [[1.0, 0.0]] for motion in there)
    back = motions_of([*row, row[-2]], curves)[-1]
    assert back.arcs.tolist() == [[-1.0, 0.0]]


def _long_plan(seed: int) -> GridPlan:
    """Return a plan of six robots that revisit places because their goals change."""
    rng, planner = np.random.default_rng(seed), Pibt(BLOCK)
    free = [tuple(cell) for cell in BLOCK.free_cells.tolist()]
    rows = [[free[k] for k in rng.permutation(len(free))[:6]]]
    for _ in range(8):
        goals = [free[k] for k in rng.permutation(len(free))[:6]]
        rows += zip(*planner.plan(rows[-1], goals, 10), strict=True)
    return finished(np.array(rows))


def _assert_ordered(found: Order) -> None:
    """Compare all pairs of motions: meeting motions are ordered, and no motion passes a resting robot."""
    motions, many = found.motions, len(found.motions.robot)
    after = np.zeros((many, many), bool)  # [a, b]: b begins after the end of a
    goes_on = np.flatnonzero(motions.following != NONE)
    after[goes_on, motions.following[goes_on]] = after[tuple(found.edges.T)] = True
    for k in range(many):
        after |= after[:, k : k + 1] & after[k]
    for a, b in np.argwhere(motions.robot[:, None] != motions.robot).tolist():
        before, following = motions.previous[b], motions.following[b]
        if sweeps_any(a, motions.swept[motions.first[b] : motions.first[b + 1]], motions):
            assert after[a, b] != after[b, a]
        if sweeps_any(a, motions.rests[b, :1], motions):  # where b's robot rests before b
            assert after[b, a] or (before != NONE and after[a, before])
        if following == NONE and sweeps_any(a, motions.rests[b, 1:], motions):  # where it stays after its last motion
            assert after[a, b]


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_all_meeting_motions_are_ordered(seed: int) -> None:
    found = find_order(_long_plan(seed), curves_on(BLOCK))
    assert not found.cycles
    _assert_ordered(found)


def test_robot_leaves_before_another_passes_repeatedly() -> None:
    """In each round the tail of robot 0 swings over the place of robot 1, which leaves last in the plan."""
    ring = [(3, 5), (3, 6), (4, 6), (4, 5)] * 6
    places = [*((5, 5),) * len(ring), (6, 5), (7, 5)]
    plan = finished(np.array(list(zip([*ring, ring[-1], ring[-1]], places, strict=True))))
    found = find_order(plan, curves_on(OPEN))
    assert not found.cycles
    _assert_ordered(found)
    assert _driven(found, curves_on(OPEN), 2).over


def test_robots_in_a_row_move_one_after_another() -> None:
    steps = [[(5, 2 + t), (5, 3 + t), (5, 4 + t)] for t in range(4)]
    plan = finished(np.array(steps))
    curves = curves_on(OPEN)
    order = find_order(plan, curves)
    assert not order.cycles
    firsts = {(order.motions.robot[a], order.motions.robot[b]) for a, b in order.edges.tolist()}
    assert {(2, 1), (1, 0)} <= firsts
    assert _driven(order, curves, 3).over


def test_rotation_of_four_robots_is_a_wait_cycle() -> None:
    ring = [(5, 5), (5, 6), (6, 6), (6, 5)]
    plan = finished(np.array([ring, ring[1:] + ring[:1]]))
    order = find_order(plan, curves_on(OPEN))
    assert len(order.cycles) == 1
    (message,) = why_stuck(order, plan)
    assert "robots 0, 1, 2 and 3 block each other" in message
    drive = _driven(order, curves_on(OPEN), 4, steps=300)
    assert drive.done == [0, 0, 0, 0]


def test_plan_past_a_parked_robot_causes_no_contact() -> None:
    plan = finished(np.array([[(5, 2), (5, 4)], [(5, 3), (5, 4)]]))
    assert not find_order(plan, curves_on(OPEN)).cycles  # they stand side by side
    alley = finished(np.array([[(1, 1), (1, 2)], [(2, 1), (1, 2)], [(2, 2), (1, 2)]]))
    order = find_order(alley, curves_on(OPEN))
    drive = _driven(order, curves_on(OPEN), 2, steps=600)
    assert drive.simulator.episode_metrics(0)["collisions_robot"] == 0
    assert drive.over or order.cycles


@pytest.mark.parametrize("late", [0.0, 0.3])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_crowds_drive_plans_without_contact(seed: int, late: float) -> None:
    rng, curves = np.random.default_rng(seed), curves_on(BLOCK)
    free = [tuple(cell) for cell in BLOCK.free_cells.tolist()]
    order = rng.permutation(len(free))
    state, goals = [free[k] for k in order[:14]], [free[k] for k in order[14:28]]
    paths = Pibt(BLOCK).plan(state, goals, 30)
    plan = finished(np.array([state, *zip(*paths, strict=True)]))
    check_plan(plan.cells, BLOCK)
    found = find_order(plan, curves)
    drive = _driven(found, curves, 14, late=late)
    figures = drive.simulator.episode_metrics(0)
    assert figures["collisions_robot"] == figures["collisions_shelf"] == 0
    assert drive.off < 1e-3
    assert drive.over or found.cycles
    at = BLOCK.cell(drive.simulator.state.pose[0, :, :2].astype(np.float64))
    arrived = [i for i in range(14) if drive.done[i] == len(found.own[i])]
    assert arrived
    for i in arrived:  # the axle is in the plan's last cell
        assert tuple(at[i].tolist()) == path_of(plan.cells[:, i])[0][-1]


def test_executed_episode_replays_to_the_bit(tmp_path: Path) -> None:
    curves = curves_on(OPEN)
    drive = _driven(find_order(finished(CELLS), curves), curves, 2)
    drive.recorder.episode.save(tmp_path / "episode.npz")
    episode = Episode.load(tmp_path / "episode.npz")
    for pose, simulator in zip(episode.pose, episode.replay(), strict=True):
        np.testing.assert_array_equal(simulator.state.pose, pose)


def test_pibt_reaches_goals_and_is_reproducible() -> None:
    plan = plan_lifelong("pibt", EnvConfig("paper46", 24), 120, 1, 7)
    assert plan.cells.shape == (121, 24, 2)
    assert all(len(steps) >= 1 for steps in plan.tasks)
    for robot, steps in enumerate(plan.tasks):
        assert list(steps) == sorted(set(steps)), robot
    same = plan_lifelong("pibt", EnvConfig("paper46", 24), 120, 1, 7)
    np.testing.assert_array_equal(plan.cells, same.cells)


@pytest.mark.usefixtures("registries")
def test_plans_of_a_user_planner_are_checked(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "class Waits:\n    def __init__(self, grid): pass\n"
        "    def plan(self, state, goals, window): return [[cell] * window for cell in state]\n"
        "class Jumps(Waits):\n    def plan(self, state, goals, window): return [[(1, 1)] * window for _ in state]\n"
        "class Short(Waits):\n    def plan(self, state, goals, window): return [[] for _ in state]\n"
        "class Fails(Waits):\n    def plan(self, state, goals, window): return 1 / 0\n"
        "class None_: pass\n"
    )
    config = EnvConfig("paper46", 4)
    for name, error, message in (
        ("Jumps", PlanError, "which is not beside it"),
        ("Short", PlanError, "must plan 5 cells"),
        ("Fails", ConfigError, "mine.py, line"),
    ):
        add_grid_planner(f"{tmp_path}/mine.py:{name}")
        with pytest.raises(error, match=message):
            plan_lifelong(f"{tmp_path}/mine.py:{name}", config, 10, 5, 0)
    with pytest.raises(ConfigError, match="has no plan"):
        add_grid_planner(f"{tmp_path}/mine.py:None_")
    add_grid_planner(f"{tmp_path}/mine.py:Waits")
    plan = plan_lifelong(f"{tmp_path}/mine.py:Waits", config, 10, 5, 0)
    assert (plan.cells == plan.cells[0]).all()
    assert plan.makespan == 0


def test_execute_reports_throughput_and_passes_audit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    given = ["execute", "--grid-planner", "pibt", "--robots", "4", "--steps", "20", "--out", str(out)]
    assert main([*given, "--delay-probability", "0.2"]) == 0
    printed = capsys.readouterr().out
    assert "all can be driven" in printed
    row = json.loads((out / "rows.jsonl").read_text())
    assert row["whole"]
    assert row["motions_done"] == row["motions"]
    assert row["seconds"] > row["planned_s"]
    assert row["collisions_robot"] == 0
    assert "goals/robot-h" in (out / "table.md").read_text()
    assert main(["audit", str(out / "episode.npz"), "--out", str(tmp_path / "audit")]) == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "name a file with a plan, or a --grid-planner"),
        (["plan.txt", "--grid-planner", "pibt"], "name a file with a plan, or a --grid-planner"),
        (["plan.txt", "--delays", "problem.json", "--delay-probability", "0.1"], "not by both"),
        (["--grid-planner", "pibt", "--scen", "two.scen"], "--scen goes with a plan of the MAPF Tracker"),
        (["nowhere.txt"], "nowhere.txt"),
        (["--grid-planner", "lacam"], "lacam"),
        (["--grid-planner", "pibt", "--robots", "9999"], "9999"),
    ],
)
def test_wrong_input_is_one_sentence(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["execute", *words, "--out", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err


def test_directions_equal_floor_headings() -> None:
    for k, (row, column) in enumerate(DIRECTIONS):  # rows go down, y goes up
        assert math.isclose(math.cos(k * math.pi / 2), column, abs_tol=1e-12)
        assert math.isclose(math.sin(k * math.pi / 2), -row, abs_tol=1e-12)


def test_crossing_robots_keep_the_plans_order() -> None:
    cross = [[(5, 4), (3, 5)], [(5, 5), (3, 5)], [(5, 6), (4, 5)], [(5, 7), (5, 5)], [(5, 7), (6, 5)]]
    plan = GridPlan(np.array(cross), ((), ()))
    order = find_order(plan, curves_on(OPEN))
    robots = {(order.motions.robot[a], order.motions.robot[b]) for a, b in order.edges.tolist()}
    assert robots == {(0, 1)}


def test_footprints_longer_than_a_cell_are_refused() -> None:
    fine = GridMap(np.zeros((24, 24), bool), name="fine", cell_size=0.5)
    with pytest.raises(PlanError, match="does not fit into cells"):
        Curves(Simulator(_config(1), 1, grid=fine))


def test_plan_without_moves_ends_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "plan.txt").write_text("0:(1,1),(5,5),\n1:(1,1),(5,5),\n")
    assert main(["execute", str(tmp_path / "plan.txt"), "--out", str(tmp_path / "out")]) == 0
    assert "2 robots, 0 steps, 0 motions: all can be driven" in capsys.readouterr().out
