"""Test disturbances on hand-made observations, the robustness table, and notes of waits and contacts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from train.evaluation.disturbances import DISTURBANCES, UNDISTURBED, Breakdown, Disturbance, Senses, body, in_aisles
from train.evaluation.places import PlaceNotes, floor_of_notes, peaks
from train.evaluation.robustness import measure, robust_table, verdict
from train.evaluation.rollout import Experiment, make_experiment, run
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.observation import observation_layout
from warehouse_env.simulation.simulator import Simulator

CONFIG = EnvConfig(num_agents=500)
LIDAR = observation_layout(CONFIG).slices["lidar"]
NOTHING = np.float32(1.0) / np.float32(7.0)  # 6 m of range
OPEN = EnvConfig(layout="open", num_agents=3, planner="astar")


def observations(metres: float) -> NDArray[np.float32]:
    """Return observations [1, 500, D] in which every ray reads `metres` and all else is 0.25."""
    rows = np.full((1, 500, observation_layout(CONFIG).size), 0.25, np.float32)
    rows[..., LIDAR] = np.float32(1.0) / np.float32(1.0 + metres)
    return rows


def senses(seed: int = 5, **strengths: Any) -> Senses:
    return Senses(Disturbance("by hand", **strengths), CONFIG, seed)


def split(rows: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the rays and all other values."""
    return rows[..., LIDAR], np.delete(rows, np.r_[LIDAR], axis=-1)


def test_lidar_noise_is_in_metres() -> None:
    rows = observations(2.0)
    rays, rest = split(senses(range_noise=0.03).see(rows))
    off = 1.0 / rays.astype(float) - 1.0 - 2.0
    assert off.mean() == pytest.approx(0.0, abs=0.001)  # of 16,000 rays
    assert off.std() == pytest.approx(0.03, rel=0.03)
    assert (rest == 0.25).all()
    assert (rows == observations(2.0)).all()  # the input is unchanged


def test_lidar_noise_keeps_ranges_valid() -> None:
    rays, _ = split(senses(range_noise=0.03).see(observations(6.0)))
    assert (rays == NOTHING).all()
    rays, _ = split(senses(range_noise=0.5).see(observations(5.9)))
    assert rays.min() == NOTHING
    rays, _ = split(senses(range_noise=0.5).see(observations(0.1)))
    assert rays.max() == 1.0


def test_lost_rays_read_free() -> None:
    rays, rest = split(senses(dropout=0.2).see(observations(2.0)))
    lost = rays == NOTHING
    assert lost.mean() == pytest.approx(0.2, abs=0.01)
    assert (rays[~lost] == observations(2.0)[0, 0, LIDAR][0]).all()
    assert (rest == 0.25).all()


@pytest.mark.parametrize(("delay", "seen"), [(0.1, [0, 0, 1, 2, 3, 4]), (0.3, [0, 0, 0, 0, 1, 2])])
def test_observations_are_delayed(delay: float, seen: list[int]) -> None:
    eye, rows, got = senses(delay=delay), observations(2.0), []
    for k in range(6):
        rows[...] = k  # in place, like the simulator
        got.append(int(eye.see(rows)[0, 0, 0]))
    assert got == seen


def test_long_and_front_steered_robots_keep_proportions() -> None:
    assert body(0.9) == RobotSpec()
    long, turned = body(1.2), body(1.2, front_steered=True)
    assert (long.wheelbase, long.front_overhang) == pytest.approx((0.8, 0.2))
    assert (turned.front_overhang, turned.rear_reach) == pytest.approx((long.rear_reach, long.front_overhang))
    assert (long.front_steered, turned.front_steered) == (False, True)


def test_aisles_are_at_most_three_cells_wide() -> None:
    lines = ["#...#....#", "..........", "#........."]
    grid = GridMap(np.array([[mark == "#" for mark in line] for line in lines]), name="drawn")
    marks = ["".join("x" if cell else "." for cell in row) for row in in_aisles(grid)]
    assert marks == [".xxx......", "x.........", ".........."]


def experiment(name: str | None, policy: str = "ppo", episodes: int = 1, seconds: float = 20.0) -> Experiment:
    return make_experiment(policy, OPEN, episodes, seconds, seed=700, disturbance=name)


def numbers(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    apart = ("ms_per_step", "config", "disturbance", "strengths")
    return [{name: value for name, value in row.items() if name not in apart} for row in rows]


def test_undisturbed_episode_equals_evaluate() -> None:
    disturbed, plain = run(experiment(UNDISTURBED)), run(experiment(None))
    assert numbers(disturbed) == numbers(plain)
    assert "disturbance" not in plain[0]
    assert disturbed[0]["disturbance"] == UNDISTURBED
    assert not any(disturbed[0]["strengths"].values())


@pytest.mark.parametrize("name", DISTURBANCES)
def test_every_disturbance_gives_a_valid_world(name: str) -> None:
    config = make_experiment("ppo", OPEN, 1, 5.0, 700, disturbance=name).config
    assert Simulator(config).num_agents == 3


@pytest.mark.parametrize("name", ["dropout", "delay", "breakdown", "short"])
def test_disturbed_episodes_are_independent_and_differ(name: str) -> None:
    base = OPEN.replace(layout="narrow", num_agents=12)
    two, one, none = (
        run(make_experiment("ppo", base, many, 70.0, 700, disturbance=disturbance))
        for many, disturbance in ((2, name), (1, name), (1, UNDISTURBED))
    )
    assert numbers(two)[:1] == numbers(one)
    assert numbers(one) != numbers(none)


def test_fastest_command_means_the_disturbed_maximum_speed() -> None:
    fast, fastest = experiment("fast", seconds=40.0), []
    assert fast.config.speed_levels == (-0.4, 0.0, 0.5, 2.0)
    run(fast, [lambda simulator, steps: fastest.append(float(simulator.state.speed.max()))])
    assert 1.6 < max(fastest) <= 2.0


def test_one_robot_of_each_world_breaks_down_in_an_aisle() -> None:
    config = EnvConfig(num_agents=8, planner="astar_turns", layout="narrow", action_repeat=2)
    simulator, watch = Simulator(config, 2), Breakdown(10.0, [3, 4])
    simulator.reset([3, 4])
    inside, broken_at = in_aisles(simulator.grid), [0.0, 0.0]
    stood: list[Any] = []
    for step in range(400):
        simulator.step(np.full((2, 8), simulator.cruise_action))
        watch(simulator, step)
        for world, robot in np.argwhere(simulator.state.alive == 0):
            if not broken_at[world]:
                broken_at[world] = simulator.seconds(world)
                row, column = simulator.grid.cell(simulator.state.pose[world, robot, :2].astype(float))
                assert inside[row, column]
        if step >= 300:
            stood.append(simulator.state.pose[simulator.state.alive == 0].tobytes())
    assert (simulator.state.alive == 0).sum(axis=1).tolist() == [1, 1]
    assert all(10.0 <= seconds < 30.0 for seconds in broken_at)
    assert len(set(stood)) == 1


def rows(name: str, goals: tuple[float, ...], contacts: float = 1.0, standing: float = 20.0) -> list[dict[str, Any]]:
    """Return two episodes on each of two floors; goals: of the first and of the second floor."""
    return [
        {
            "disturbance": name, "policy": "ppo", "layout": layout, "robots": robots, "episode": episode,
            "seconds": 300.0, "goals_per_robot_hour": goal + change, "robot_km": 2.0, "collisions_robot": contacts,
            "collisions_shelf": contacts / 2, "collisions_person": contacts / 4,
            "longest_standing_s": standing + change,
        }
        for (layout, robots), goal in zip((("open", 16), ("narrow", 32)), goals, strict=True)
        for episode, change in enumerate((-1.0, 1.0))
    ]  # fmt: skip


USUAL = rows("none", (100.0, 60.0))


def test_measures_by_hand() -> None:
    found = measure(USUAL)
    # two strata of standard error 1: half of sqrt(2); one degree of freedom each: t = 4.303 of two
    assert (found.goals.mean, found.goals.high) == pytest.approx((80.0, 80.0 + 4.30265 * 2**0.5 / 2), rel=1e-5)
    assert (found.robot_contacts, found.shelf_contacts, found.standing) == (0.5, 0.25, 20.0)
    worse = measure(rows("delay", (90.0, 30.0)))
    assert worse.share_of(found) == 0.75
    assert worse.worst_floor(found) == (0.5, ("narrow", 32))


@pytest.mark.parametrize(
    ("goals", "contacts", "standing", "word"),
    [
        ((100.0, 60.0), 1.0, 20.0, "holds"),
        ((92.0, 52.0), 1.5, 79.0, "holds"),
        ((92.0, 51.0), 1.0, 79.0, "slower"),
        ((92.0, 51.0), 1.0, 80.0, "jams"),
        ((92.0, 51.0), 1.51, 80.0, "contacts"),
    ],
)
def test_verdicts(goals: tuple[float, ...], contacts: float, standing: float, word: str) -> None:
    assert verdict(measure(rows("delay", goals, contacts, standing)), measure(USUAL)) == word


def test_table_has_a_line_per_disturbance() -> None:
    table = robust_table([*USUAL, *rows("delay", (90.0, 30.0))])
    assert "open with 16, narrow with 32 robots; 2 episodes of 300 s each" in table.title
    first, second = table.cells
    assert first == ("undisturbed", "ppo", "80.0 [77.0, 83.0]", "", "", "0.50", "0.25", "0.12", "20", "")
    assert second[0] == "seen 0.2 s late"
    assert second[3:5] == ("75", "50 (narrow, 32)")
    assert second[-1] == "slower"
    assert all(word in table.note for word in ("contacts", "jams", "slower", "holds"))


def test_place_notes_agree_with_rows() -> None:
    base = EnvConfig(layout="narrow", num_agents=12, planner="astar")
    experiment = make_experiment("follow", base, 2, 60.0, seed=400)
    places = PlaceNotes(experiment)
    rows, notes = run(experiment, [places]), places.rows()
    assert sum(row["collisions_robot"] for row in rows) > 0
    for row, note in zip(rows, notes, strict=True):
        assert [row[name] for name in ("policy", "layout", "robots", "seed")] == [
            note[name] for name in ("policy", "layout", "robots", "seed")
        ]
        assert note["seconds"] == pytest.approx(60.0)
        waited = sum(seconds for _, seconds in note["waited"])
        assert waited == pytest.approx(row["waiting_share"] * 12 * 60.0, abs=0.01 * len(note["waited"]))
        assert sum(kind == "shelf" for *_, kind in note["contacts"]) == row["collisions_shelf"]
        # Contacts of three robots in one step may share a point.
        assert 0 <= row["collisions_robot"] - sum(kind == "robot" for *_, kind in note["contacts"]) <= 1


def test_notes_add_up_to_a_floor() -> None:
    one = {"shape": [2, 3], "seconds": 1800.0, "waited": [[0, 10.0], [5, 2.0]], "contacts": [[1.0, 2.0, "robot"]]}
    two = {"shape": [2, 3], "seconds": 1800.0, "waited": [[5, 4.0]], "contacts": []}
    floor = floor_of_notes([one, two])
    assert floor.hours == 1.0
    assert floor.waiting.tolist() == [[10.0, 0.0, 0.0], [0.0, 0.0, 6.0]]
    assert floor.contacts.tolist() == [[1.0, 2.0]]


def test_peaks_are_separate_hot_squares() -> None:
    heat = np.zeros((7, 9))
    heat[1, 1], heat[1, 2] = 5.0, 4.0  # sum 9: each square holds both, and (1, 1) is hotter
    heat[5, 7] = 7.0
    heat[3, 5] = 1.0
    assert peaks(heat, 9, radius=1) == [(1, 1, 9.0), (5, 7, 7.0), (3, 5, 1.0)]
    assert peaks(heat, 1, radius=1) == [(1, 1, 9.0)]
    assert peaks(np.zeros((3, 3)), 3, radius=1) == []
    assert heat.sum() == 17.0  # unchanged
