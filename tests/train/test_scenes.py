"""Scenes fit their floors at every seed, are played independently of each other, and are counted right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from train.cli import main
from train.evaluation.scenes import SCENES, SceneJob, scene_table
from train.reporting.rows import Row, read_rows, wilson_interval
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.well_formed import cut_off, parking_of

BASE = EnvConfig(planner="astar", tasks="one_shot")


@pytest.mark.parametrize("name", sorted(SCENES))
def test_scenes_are_well_formed_and_touch_nothing(name: str) -> None:
    scene = SCENES[name]()
    simulator = Simulator(BASE.replace(num_agents=scene.robots), 10, grid=scene.grid)
    drawn = [scene.draw(np.random.default_rng(seed)) for seed in range(10)]
    simulator.reset_to(drawn, seed=0)  # raises where something touches
    assert not np.array_equal(drawn[0].pose, drawn[1].pose)
    for one in drawn:
        starts = scene.grid.cell(one.pose[:, :2])
        if name.startswith("swap"):  # a start is another's goal, so all that can be asked is the way from the middle
            starts = np.broadcast_to(np.array(scene.grid.shape) // 2, starts.shape)
        assert not cut_off(scene.grid, starts, one.goal, parking_of(scene.grid, BASE)).any()


def played(seconds: float, seeds: range) -> list[Row]:
    return SceneJob("head_on_two_cells", "brake", BASE, seconds, seeds).run(lambda done: None).rows


def test_a_seed_does_not_depend_on_those_beside_it() -> None:
    rows = [played(20.0, seeds) for seeds in (range(3, 4), range(2, 4))]
    assert rows[0] == rows[1][1:]
    assert rows[0][0]["robots"] == 2


def test_command_prints_the_share(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = "--scene head_on_two_cells --policy follow --seeds 2 --seconds 2 --planner astar --seed 5 --out"
    assert main(["scenes", *options.split(), str(tmp_path)]) == 0
    assert "0.0 [0.0, 65.8]" in capsys.readouterr().out  # nobody drives 16 m in 2 s
    rows = read_rows(tmp_path / "rows.jsonl")
    assert [(row["seed"], row["resolved"], row["arrived"]) for row in rows] == [(5, False, 0), (6, False, 0)]
    assert "head_on_two_cells" in scene_table(rows).markdown()
    assert main(["scenes", "--scene", "head_on", "--out", str(tmp_path)]) == 2
    assert "head_on_two_cells" in capsys.readouterr().err


def test_contacts_of_all_kinds_are_counted() -> None:
    (row,) = played(2.0, range(3, 4))
    contacts = {"collisions_robot": 1.0, "collisions_shelf": 2.0, "collisions_person": 4.0}
    assert contacts.keys() <= row.keys()
    ((_, _, _, _, _, _, collisions, _),) = scene_table([{"scene": "x", "policy": "brake", **row, **contacts}]).cells
    assert collisions == "7"


def test_wilson_interval_by_hand() -> None:
    # Newcombe (1998), table I: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
    for successes, trials, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611)):
        found = wilson_interval(successes, trials)
        assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)
    assert wilson_interval(1000, 1000).high == 1.0
