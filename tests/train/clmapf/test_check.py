"""Test the benchmark's files and its exact check, against hand-made faults and dense sampling."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from train.cli import main
from train.clmapf.instance import (
    Instance,
    body_gap,
    disc_gap,
    read_instance,
    read_solution,
    why_impossible,
    write_solution,
)
from train.clmapf.jobs import check, solve
from train.clmapf.motions import AUTHORS_STEP, extent
from train.reporting.rows import read_rows
from warehouse_env.errors import MapError
from warehouse_env.routes.reeds_shepp import rolled

TEXT = """agents:
  - start: [5, 15, 0]
    name: agent0
    goal: [22, 15, 1.57]
map:
  dimensions: [30, 40]
  obstacles:
    - [15.5, 1e1]  # a disc
"""


def test_instance_is_read_in_our_frame(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(TEXT)
    instance = read_instance(tmp_path / "a.yaml", "a")
    assert (instance.width, instance.height, instance.names) == (30.0, 40.0, ("agent0",))
    assert instance.goals.tolist() == [[22.0, 15.0, -1.57]]  # yaw turns clockwise
    assert instance.discs.tolist() == [[15.5, 10.0]]
    (tmp_path / "b.yaml").write_text(TEXT.replace("[15.5, 1e1]", "[-1, -1]"))
    assert read_instance(tmp_path / "b.yaml", "b").discs.shape == (0, 2)


@pytest.mark.parametrize("written", ["5", "5e0", "+5", "0.5e1"])
def test_all_number_formats_are_read(tmp_path: Path, written: str) -> None:
    """YAML 1.1 reads 5e0 as text, but other programs write such numbers."""
    (tmp_path / "a.yaml").write_text(TEXT.replace("[5, 15, 0]", f"[{written}, 15, 0]"))
    assert read_instance(tmp_path / "a.yaml", "a").starts[0, 0] == 5.0


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("agents:", "robots:", "has no agents"),
        ("[5, 15, 0]", "[5, 15]", "must be 3 numbers"),
        ("[5, 15, 0]", "[5, .nan, 0]", "must be 3 numbers"),
        ("[5, 15, 0]", "[5, 1" + "0" * 400 + ", 0]", "must be 3 numbers"),
        ("[30, 40]", "[30, -40]", "must lie between 0"),
        ("    goal", "  goal", "line 4 is no YAML"),
        ("name: agent0", "start: [1, 2, 3]", "a name is given twice"),
    ],
)
def test_wrong_instance_is_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    (tmp_path / "a.yaml").write_text(TEXT.replace(old, new))
    with pytest.raises(MapError, match=sentence.replace("[", r"\[")):
        read_instance(tmp_path / "a.yaml", "a")


def test_clmapf_solves_and_checks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = str(tmp_path / "instances"), str(tmp_path / "out")
    Path(folder).mkdir()
    for number in (1, 2):
        (Path(folder) / f"{number}.yaml").write_text(TEXT.replace("15, 0]", f"{14 + number}, 0]"))
    assert main(["clmapf", folder, "--out", out, "--processes", "1"]) == 0
    shown = capsys.readouterr().out
    assert "2: 100 [34, 100]%" in shown
    assert "impossible as stated: none" in shown
    rows = read_rows(Path(out) / "rows.jsonl")
    assert all(row["solved"] and row["flowtime"] >= row["flowtime_alone"] - 1.0 for row in rows)
    checked = ["clmapf", folder, "--check", "--solutions", f"{out}/solutions", "--out", str(tmp_path / "checked")]
    assert main([*checked, "--processes", "1"]) == 0
    solution = next((Path(out) / "solutions").iterdir())
    lines = solution.read_text().splitlines()
    last = max(k for k, line in enumerate(lines) if line.startswith("    - x:"))
    solution.write_text("\n".join([*lines[:last], "    - x: 1.0", *lines[last + 1 :]]) + "\n")
    assert main([*checked, "--processes", "1"]) == 1
    assert "ends off its goal" in capsys.readouterr().out


def test_clmapf_names_missing_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["clmapf", str(tmp_path)]) == 2
    assert "holds no instances" in capsys.readouterr().err
    (tmp_path / "a.yaml").write_text(TEXT)
    assert main(["clmapf", str(tmp_path), "--check", "--out", str(tmp_path / "out")]) == 2
    assert "no solution named" in capsys.readouterr().err


def instance_of(starts: list[Any], goals: list[Any], discs: list[Any] | None = None, side: float = 50.0) -> Instance:
    names = tuple(f"agent{i}" for i in range(len(starts)))
    return Instance(
        "hand", side, side, names, np.array(starts, float), np.array(goals, float),
        np.array(discs or [], float).reshape(-1, 2),
    )  # fmt: skip


def straight(*, seconds: float = 10.0, y: float = 20.0) -> np.ndarray[Any, Any]:
    """Return states from (10, y) east to (20, y)."""
    return np.array([[10.0, y, 0.0, 0.0], [20.0, y, 0.0, seconds]])


EAST = instance_of([[10, 20, 0]], [[20, 20, 0]])


def kinds(instance: Instance, *states: np.ndarray[Any, Any]) -> list[str]:
    found = check(instance, {f"agent{i}": one for i, one in enumerate(states)})
    return [fault.kind for fault in found.faults]


def test_straight_route_is_faultless_and_measured() -> None:
    found = check(EAST, {"agent0": straight()})
    assert (found.faults, found.makespan, found.flowtime, found.driven) == ([], 10.0, 10.0, 10.0)
    waits = np.vstack([straight(), [20.0, 20.0, 0.0, 30.0]])
    assert check(EAST, {"agent0": waits}).makespan == 10.0  # waiting at the goal does not count


@pytest.mark.parametrize(
    ("states", "kind"),
    [
        (straight(seconds=9.0), "too fast"),
        ([[10, 20, 0, 0], [19, 20, 0, 9]], "ends off its goal"),
        ([[11, 20, 0, 0], [20, 20, 0, 9]], "begins off its start"),
        ([[10, 20, 0, 0], [20, 20, math.pi, 20]], "ends off its goal"),
        ([[10, 20, 0, 0], [15, 20.5, 0, 6], [20, 20, 0, 12]], "states that no arc joins"),
        ([[10, 20, 0, 0], [10, 20, 0.5, 2], [20, 20, 0, 20]], "a turn that is too tight"),
        ([[10, 20, 0, 0], [10, 20, 0, -1], [20, 20, 0, 20]], "time runs backwards"),
        ([[10, 20, 0, 0], [-2, 20, 0, 12], [20, 20, 0, 40]], "the axle leaves the floor"),
    ],
)
def test_each_fault_is_found(states: Any, kind: str) -> None:
    assert kind in kinds(EAST, np.array(states, float))


def test_reach_beyond_the_border_is_measured() -> None:
    """A robot with its axle at x = 1.5, heading west, reaches half a unit beyond the border."""
    instance = instance_of([[10, 20, math.pi]], [[1.5, 20, math.pi]])
    found = check(instance, {"agent0": np.array([[10, 20, math.pi, 0], [1.5, 20, math.pi, 8.5]])})
    assert (found.faults, found.body_beyond_border) == ([], pytest.approx(0.5))


def test_missing_and_unknown_robots() -> None:
    assert [fault.kind for fault in check(EAST, {"other": straight()}).faults] == ["has no states", "is no robot"]


def test_curvature_and_extent_of_an_arc() -> None:
    """Drive half a left circle of radius 3 about (10, 23) in two arcs; radius 2.9 is too tight."""
    for radius, faults in ((3.0, []), (2.9, ["a turn that is too tight"] * 2)):
        quarter = 0.5 * math.pi * radius
        middle = [10 + radius, 20 + radius, 0.5 * math.pi, quarter]
        end = [10.0, 20 + 2 * radius, math.pi, 2 * quarter]
        assert kinds(instance_of([[10, 20, 0]], [end[:3]]), np.array([[10, 20, 0, 0], middle, end])) == faults
    arc = (0.0, 1.0, 10.0, 20.0, -0.25 * math.pi, 1.5 * math.pi, 1 / 3)  # past due south: heading 0 is the lowest
    assert extent(arc, 0.0, 0.0)[2] == pytest.approx(20.0 + 3.0 * math.cos(0.25 * math.pi) - 3.0)


def test_overlaps_between_states_are_found() -> None:
    near = instance_of([[10, 20, 0], [20, 21.9, math.pi]], [[20, 20, 0], [10, 21.9, math.pi]])
    found = check(near, {"agent0": straight(), "agent1": np.array([[20, 21.9, math.pi, 0], [10, 21.9, math.pi, 10]])})
    assert [fault.kind for fault in found.faults] == ["overlaps"]
    assert found.faults[0].time == pytest.approx(3.0, abs=1e-3)  # 10 - 2 * 2 apart, at 2 a second
    late = np.array([[10, 20, 0, 40], [20, 20, 0, 50]])
    crossing = instance_of([[10, 20, 0], [15, 10, math.pi / 2]], [[20, 20, 0], [15, 30, math.pi / 2]])
    up = np.array([[15, 10, math.pi / 2, 0], [15, 30, math.pi / 2, 20]])
    assert kinds(crossing, late, up) == []
    assert kinds(crossing, straight(), up) == []  # at 7 s one robot has just left the square that the other enters
    assert kinds(crossing, straight(seconds=10.1), up) == ["overlaps"]


@pytest.mark.parametrize(("y", "clips"), [(21.81, False), (21.79, True)])
def test_discs_are_round_and_exact(y: float, clips: bool) -> None:
    assert kinds(instance_of([[10, 20, 0]], [[20, 20, 0]], [[15, y]]), straight()) == ["overlaps obstacle"] * clips


def test_authors_step_length_is_accepted() -> None:
    states = np.array([[10, 20, 0, 0], [10 + AUTHORS_STEP, 20, 0, 1], [13, 20, 0, 2]])
    instance = instance_of([[10, 20, 0]], [[13, 20, 0]])
    assert kinds(instance, states) == ["too fast"]
    found = check(instance, {"agent0": states}, AUTHORS_STEP)
    assert (found.faults, found.unit_of_t, found.makespan) == ([], AUTHORS_STEP, 2 * AUTHORS_STEP)


def wander(rates: list[int], start: tuple[float, float, float]) -> np.ndarray[Any, Any]:
    """Return the states of steps of 1.2, one per rate: -3 to 3 by direction and side; 0 waits."""
    states = [(*start, 0.0)]
    for n, rate in enumerate(rates, start=1):
        bend = 0.0 if abs(rate) == 1 else (1 / 3 if abs(rate) == 2 else -1 / 3)
        states.append((*rolled(*states[-1][:3], 1.2 * np.sign(rate), bend), 1.2 * n))
    return np.array(states, float)


def sampled(states: np.ndarray[Any, Any], t: float) -> np.ndarray[Any, Any]:
    """Return the pose at t by 40 short chords, independently of the check's formulas."""
    n = int(np.searchsorted(states[:, 3], t, side="right")) - 1
    if n + 1 >= len(states):
        return states[-1, :3]
    share = (t - states[n, 3]) / (states[n + 1, 3] - states[n, 3])
    turn = math.remainder(states[n + 1, 2] - states[n, 2], math.tau)
    way = states[n + 1, :2] - states[n, :2]
    forwards = way @ [math.cos(states[n, 2] + turn / 2), math.sin(states[n, 2] + turn / 2)] >= 0
    length = np.hypot(*way) * (turn / 2 / math.sin(turn / 2) if turn else 1.0) * (1 if forwards else -1)
    x, y, heading = states[n, :3]
    for _ in range(40):
        middle = heading + share * turn / 80
        x, y = x + share * length / 40 * math.cos(middle), y + share * length / 40 * math.sin(middle)
        heading += share * turn / 40
    return np.array([x, y, heading])


RATES = st.lists(st.integers(-3, 3), min_size=1, max_size=6)


@settings(max_examples=30, deadline=None)
@given(RATES, RATES, st.floats(-4, 4), st.floats(-4, 4), st.floats(-4, 4), st.floats(-4, 4), st.floats(-4, 4))
def test_check_agrees_with_dense_sampling(
    one: list[int], two: list[int], dx: float, dy: float, heading: float, disc_x: float, disc_y: float
) -> None:
    own, other = wander(one, (25.0, 25.0, 0.0)), wander(two, (25.0 + dx, 25.0 + dy, heading))
    disc = np.array([25.0 + disc_x, 25.0 + disc_y])
    instance = instance_of([own[0, :3], other[0, :3]], [own[-1, :3], other[-1, :3]], [disc])
    found = check(instance, {"agent0": own, "agent1": other})
    times = np.arange(0.0, max(own[-1, 3], other[-1, 3]) + 0.01, 0.02)
    bodies = min(body_gap(sampled(own, t), sampled(other, t)) for t in times)
    discs = min(disc_gap(sampled(own, t), disc) for t in times)
    discs = min(discs, *(disc_gap(sampled(other, t), disc) for t in times))
    overlaps = [fault.size for fault in found.faults if fault.kind == "overlaps"]
    clips = [fault.size for fault in found.faults if fault.kind == "overlaps obstacle"]
    step = 0.02 * 1.5  # largest change of a gap between two samples
    for least, faults, depth in ((bodies, overlaps, 2 * step), (discs, clips, step)):
        assert bool(faults) >= (least < -1e-3)  # the check finds all sampled overlaps
        assert least < depth or not faults  # sampling confirms the check's faults
        if faults:
            assert max(faults) == pytest.approx(-least, abs=depth + 1e-3)
    if not overlaps:
        assert found.least_gap == pytest.approx(min(bodies, 1.0), abs=2 * step)
    if not clips:
        assert found.least_disc_gap == pytest.approx(min(discs, 1.0), abs=step + 2e-3)


def test_impossible_instances_state_why() -> None:
    assert not list(why_impossible(EAST))
    text = " ".join(why_impossible(instance_of([[10, 20, 0], [12, 21, 0]], [[20, 20, 0], [55, 5, 0]], [[22.7, 20.0]])))
    assert "the starts of agent0 and agent1 overlap" in text
    assert "the goal of agent0 overlaps obstacle 0 by 0.100" in text
    assert "the goal of agent1 is off the floor" in text


def test_solution_round_trips_without_faults(tmp_path: Path) -> None:
    """Three robots swap places around a disc; one must wait or detour."""
    instance = instance_of(
        [[5, 15, 0], [25, 15, math.pi], [15, 5, 1.57]],
        [[25, 15, 0], [5, 15, math.pi], [15, 25, 1.57]],
        [[15, 15]],
        30.0,
    )
    routes = solve(instance, 0)[0].routes
    write_solution(tmp_path / "s.yaml", instance.names, routes, 0.0)
    found = check(instance, read_solution(tmp_path / "s.yaml"))
    assert found.faults == []
    assert min(found.least_gap, found.least_disc_gap) > 0.004
    assert found.makespan == pytest.approx(max(route[-1, -1] for route in routes))
    assert all(np.array_equal(a, b) for a, b in zip(routes, solve(instance, 0)[0].routes, strict=True))
