"""Test evaluations, the demo and the robustness table: whole, reproducible, resumable, independent rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from train.cli import main
from train.commands.evaluate import Evaluate
from train.evaluation import episodes
from train.evaluation.rollout import Experiment, make_experiment, pair_centres, run
from train.reporting.rows import RowFile, read_rows
from warehouse_env import __version__
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.maps.movingai import EXAMPLE_MAP, write_map
from warehouse_env.simulation.tasks.orders import Order, write_orders
from warehouse_env.traffic_spec import TRAFFIC, TrafficSpec

AFTER_4 = replace(TRAFFIC["assist"], right_of_way_after=4.0)
OPEN = EnvConfig(layout="open", num_agents=4, planner="astar")


def timeless(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{name: value for name, value in row.items() if name != "ms_per_step"} for row in rows]


def small(episodes: int = 1, policy: str = "brake", base: EnvConfig = OPEN, seconds: float = 30.0) -> Experiment:
    return make_experiment(policy, base, episodes, seconds, seed=1_000_000)


def test_rows_have_all_fields() -> None:
    rows = run(small(episodes=2))
    for k, row in enumerate(rows):
        assert (row["policy"], row["layout"], row["robots"]) == ("brake", "open", 4)
        assert (row["episode"], row["seed"], row["version"]) == (k, 1_000_000 + k, __version__)
        assert EnvConfig.from_dict(row["config"]) == small().config
        assert row["robot_km"] > 0
        assert row["ms_per_step"] > 0


def test_episodes_are_independent() -> None:
    assert timeless(run(small(episodes=3)))[:1] == timeless(run(small(episodes=1)))


def test_one_shot_episodes_end_when_all_have_arrived() -> None:
    base = OPEN.replace(tasks="one_shot", num_agents=1)
    rows = run(small(episodes=2, base=base, seconds=300.0))
    for row in rows:
        assert row["success_rate"] == 1.0
        assert row["makespan_s"] < 300
    # A finished world's measures do not depend on slower worlds beside it.
    assert timeless(run(small(episodes=1, base=base, seconds=300.0))) == timeless(rows)[:1]


def test_contacts_are_marked_once_for_each_pair() -> None:
    points = np.array([[0, 0], [1, 0], [10, 0], [10, 2], [0, 1.5]], dtype=np.float32)
    assert pair_centres(points).tolist() == [[0.5, 0.0], [0.0, 0.75], [10.0, 1.0]]
    assert pair_centres(points[:0]).shape == (0, 2)


def command(tmp_path: Path, *more: str) -> list[str]:
    fixed = "--layout open --robots 2 --seconds 10 --planner astar --no-pictures --out"
    return ["evaluate", *fixed.split(), str(tmp_path), *more]


@pytest.mark.parametrize(
    ("options", "traffic"),
    [
        ({}, ("none", "rules")),
        ({"traffic": "own:routes=false"}, ("none", TrafficSpec(shield=True, right_of_way=True))),
        ({"traffic": "own:routes=true"}, ("routes", "rules")),
        ({"traffic": "shield"}, ("shield", "shield")),
        ({"traffic": "assist:right_of_way_after=4"}, (AFTER_4, AFTER_4)),
    ],
)
def test_policy_gets_its_needs_unless_options_override_them(options: dict[str, str], traffic: tuple[Any, Any]) -> None:
    configs = [one.config for one in Evaluate(policy=("follow", "greedy"), **options).experiments()]
    assert tuple(config.traffic for config in configs) == traffic
    assert [config.action_repeat for config in configs] == [1, 1]


def test_resume_runs_only_missing_episodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(command(tmp_path, "--policy", "brake", "--episodes", "1")) == 0
    played: list[tuple[str, tuple[int, ...]]] = []

    def watched(experiment: Experiment, *rest: Any) -> list[dict[str, Any]]:
        played.append((experiment.policy, experiment.episodes))
        return run(experiment, *rest)

    monkeypatch.setattr(episodes, "run", watched)
    assert main(command(tmp_path, "--policy", "brake", "follow", "--episodes", "2", "--resume")) == 0
    assert played == [("brake", (1,)), ("follow", (0,)), ("follow", (1,))]
    resumed = read_rows(tmp_path / "rows.jsonl")
    assert main(command(tmp_path / "fresh", "--policy", "brake", "follow", "--episodes", "2")) == 0
    assert timeless(resumed) == timeless(read_rows(tmp_path / "fresh" / "rows.jsonl"))


def test_rows_of_different_floors_of_one_name_stay_apart(tmp_path: Path) -> None:
    """Another map or other directions under the same name start new rows."""
    floor, one_way = tmp_path / "mine.map", np.zeros((12, 16), np.uint8)
    options = "--policy follow --robots 2 --episodes 1 --seconds 2 --planner astar --no-pictures --resume"
    for cell in range(3):
        one_way[5, :cell] = 1
        write_map(GridMap(np.zeros((12, 16), bool), one_way=one_way), floor)
        for _ in range(2):
            assert main(["evaluate", *options.split(), "--map", str(floor), "--out", str(tmp_path)]) == 0
    rows = read_rows(tmp_path / "rows.jsonl")
    assert len({row["versions"][str(floor)] for row in rows}) == len(rows) == 3


@pytest.mark.parametrize("name", ["evaluate", "robust", "audit", "demo"])
def test_rows_are_replaced_only_on_request(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = "--policy brake --layout open --robots 2 --episodes 1 --seconds 2"
    options = {
        "evaluate": f"{short} --planner astar --no-pictures",
        "robust": f"{short} --planner astar --disturbance dropout",
        "audit": f"{short} --planner astar",
        "demo": f"{short} --video-seconds 0",
    }[name]
    RowFile(tmp_path / "rows.jsonl").add([{"old": 1}, {"old": 2}])
    assert main([name, *options.split(), "--out", str(tmp_path)]) == 2
    message = capsys.readouterr().err
    assert f"{tmp_path / 'rows.jsonl'} holds 2 rows already: " in message
    assert "--overwrite replaces them" in message
    assert "--resume keeps them" in message
    assert read_rows(tmp_path / "rows.jsonl") == [{"old": 1}, {"old": 2}]


def test_map_and_layout_options_give_one_name(tmp_path: Path) -> None:
    floor = str(EXAMPLE_MAP)
    layouts = Evaluate(layout=(floor, "open"), policy=("brake",)).experiments()
    assert [one.config.layout for one in layouts] == [floor, "open"]
    words = "--policy brake --episodes 1 --robots 2 --seconds 10 --planner astar --no-pictures --out"
    assert main(["evaluate", *words.split(), str(tmp_path), "--map", floor]) == 0
    assert [row["layout"] for row in read_rows(tmp_path / "rows.jsonl")] == [floor]


def test_orders_are_carried_out_and_tabled(tmp_path: Path) -> None:
    orders, out = tmp_path / "orders.csv", tmp_path / "out"
    (pick, other, *_), (drop, *_), _ = make_layout("open").endpoints
    write_orders(orders, [Order(0.0, (pick,), drop, 60.0, 10.0), Order(1.0, (other,), drop, 60.0, 10.0)])
    drive = ["--policy", "follow", "--layout", "open", "--robots", "4", "--episodes", "1", "--seconds", "60"]
    work = ["--planner", "astar", "--service", "1", "--orders", str(orders), "--allocation", "optimal", "--battery"]
    assert main(["evaluate", *drive, *work, "--no-pictures", "--out", str(out)]) == 0
    row = read_rows(out / "rows.jsonl")[0]
    assert 0 < row["orders_done"] <= row["orders_released"]
    assert {"station_utilisation", "empty_driving", "lowest_charge"} <= set(row)
    table = (out / "table.md").read_text()
    assert all(heading in table for heading in ("orders/h", "late orders", "stations used %", "lowest charge %"))
    assert main(["evaluate", *drive, "--orders", str(orders), "--orders-per-hour", "9", "--out", str(out)]) == 2


def test_demo_writes_rows_pictures_and_a_video(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for package in ("matplotlib", "pygame", "imageio_ffmpeg"):
        pytest.importorskip(package)
    options = "--policy follow ppo --layout open --robots 2 --episodes 1"
    short = "--seconds 10 --video-seconds 1 --processes 1"
    assert main(["demo", *options.split(), *short.split(), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "collisions/km" in printed
    assert "all else to" in printed
    assert {path.name for path in tmp_path.iterdir()} == {
        "rows.jsonl", "table.md", "collisions.png", "video.mp4",
    }  # fmt: skip
    assert len(read_rows(tmp_path / "rows.jsonl")) == 2
    assert (tmp_path / "video.mp4").read_bytes()[4:8] == b"ftyp"


COMMON = "robust --policy follow brake --layout open --robots 2 --episodes 2 --seconds 5 --planner astar --seed 700"


def test_robust_resumes_and_writes_one_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = [*COMMON.split(), "--disturbance", "delay", "long", "--out", str(tmp_path)]
    assert main(command) == 0
    printed = capsys.readouterr().out
    lines = [line for line in (tmp_path / "table.md").read_text().splitlines() if line.startswith("| ")]
    named = [tuple(cell.strip() for cell in line.split("|")[1:3]) for line in lines[2:]]
    summaries = ("undisturbed", "seen 0.2 s late", "body 1.2 m long")
    assert named == [(summary, policy) for summary in summaries for policy in ("follow", "brake")]
    assert all(summary in printed for summary in summaries)
    rows = read_rows(tmp_path / "rows.jsonl")
    assert len(rows) == 3 * 2 * 2
    assert {row["seed"] for row in rows} == {700, 701}
    assert {row["config"]["robot"]["length"] for row in rows if row["disturbance"] == "long"} == {1.2}

    kept = (tmp_path / "rows.jsonl").read_text().splitlines()
    (tmp_path / "rows.jsonl").write_text("\n".join(kept[:5]) + "\n")
    assert main([*command, "--resume"]) == 0
    again = read_rows(tmp_path / "rows.jsonl")
    assert again[:5] == rows[:5]
    timeless = [[{**row, "ms_per_step": 0} for row in found] for found in (rows, again)]
    assert timeless[0] == timeless[1]
