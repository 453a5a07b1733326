"""What learning adds: the table by hand, trainings that go on, and the whole study, small."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from agents.weights_folder import read_record
from train.cli import main
from train.reporting.rows import Row, read_rows
from train.tables.learning import command
from train.tables.learning.command import configs, train_missing
from train.tables.learning.figures import SETTINGS, START, Setting, learning_tables, samples, setting_of
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.traffic_spec import TrafficSpec, read_traffic

SMALL: dict[str, Any] = {
    "layouts": ("open",), "robots": (2,), "rows": 4, "planner": "astar", "rollout": 4, "episode_seconds": 3.0,
    "hidden": (20,), "threads": 1, "progress": False,
}  # fmt: skip


def config_of(setting: Setting) -> dict[str, Any]:
    return EnvConfig(traffic=read_traffic(setting.traffic, TrafficSpec())).to_dict()


def row(policy: str, late: float, setting: int = 0, robots: int = 4, **more: Any) -> Row:
    return {
        "policy": policy, "layout": "open", "robots": robots, "config": config_of(SETTINGS[setting]),
        "late_goals_per_robot_hour": late, "waiting_share": 0.1, "path_length_ratio": 1.05, "near_misses": 2.0,
        "robot_km": 4.0, "collisions_per_km": 0.5, **more,
    }  # fmt: skip


POLICIES = {"greedy": ["greedy"], START: ["runs/start"], "reinforce": ["runs/a", "runs/b", "runs/c"]}
ROWS = [
    *(row("greedy", late, setting=4, robots=1) for late in (99.0, 101.0)),
    *(row("greedy", late, setting=4) for late in (89.0, 91.0)),
    *(row("runs/start", late) for late in (50.0, 52.0)),
    *(row(f"runs/{name}", late + off) for name, late in (("a", 70.0), ("b", 71.0), ("c", 72.0)) for off in (-5, 5)),
]


def test_a_trained_policys_samples_are_the_means_of_its_trainings() -> None:
    late = lambda row: row["late_goals_per_robot_hour"]  # noqa: E731
    assert samples(ROWS, POLICIES["reinforce"], late) == [70.0, 71.0, 72.0]
    assert samples(ROWS[4:], POLICIES[START], late) == [50.0, 52.0]


def test_the_table_by_hand() -> None:
    (table,) = learning_tables(ROWS, POLICIES)
    lines = {line[:2]: dict(zip(table.header, line, strict=True)) for line in table.cells}
    assert list(lines) == [("none", START), ("none", "reinforce"), ("all: right of way", "greedy")]
    trained = lines["none", "reinforce"]
    # mean 71, deviation 1 over 3 trainings: 4.303 / sqrt(3) = 2.48 either way, of 100 alone
    assert trained["late %"] == "71.0 [68.5, 73.5]"
    # 71 - 51, half-widths 2.48 and 12.7 (2 episodes)
    assert trained["above the start"] == "+20.0 [+7.1, +32.9]"
    assert (trained["trainings"], trained["episodes"]) == ("3", "6")
    assert (trained["waiting %"], trained["detour %"]) == ("10", "5")
    assert (trained["near misses/km"], trained["contacts/km"]) == ("0.500", "0.500")
    assert lines["none", START]["above the start"] == ""


def test_every_setting_has_its_name_back() -> None:
    assert [setting_of({"config": config_of(setting)}) for setting in SETTINGS] == [one.name for one in SETTINGS]
    old = {"protective_field": True, "reroute": True, "right_of_way": True, "right_of_way_after": 12.0}
    assert setting_of({"config": old}) == "all: right of way"
    with pytest.raises(KeyError):
        setting_of({"config": {"traffic": {"shield": "lidar"}}})


def test_trainings_that_are_missing_are_made_and_others_stay(tmp_path: Path) -> None:
    wanted = {name: [replace(one, **SMALL) for one in group] for name, group in configs(tmp_path, range(2), 16).items()}
    assert len(list(train_missing(wanted))) == 7
    for name in ("reinforce", "ppo", "threaded_ppo"):
        assert {read_record(one.directory).algorithm for one in wanted[name]} == {name}
    assert not list(train_missing(wanted))
    with pytest.raises(ConfigError, match="was trained with other options: name another --out"):
        list(train_missing({"reinforce": [replace(wanted["reinforce"][0], gamma=0.5)]}))


def test_a_training_that_was_stopped_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (config,) = (replace(one, **SMALL, checkpoint_seconds=0.0) for one in configs(tmp_path, range(1), 48)["reinforce"])
    from train.reinforce import Reinforce

    update, calls = Reinforce.update, []

    def stopped(self: Reinforce, number: int, spent: float) -> dict[str, float]:
        calls.append(number)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return update(self, number, spent)

    monkeypatch.setattr(Reinforce, "update", stopped)
    with pytest.raises(KeyboardInterrupt):
        list(train_missing({"reinforce": [config]}))
    list(train_missing({"reinforce": [config]}))
    assert calls == [0, 1, 2, 2]
    assert read_record(config.directory).training["steps"] == 48


def test_the_study_from_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = command.configs
    monkeypatch.setattr(
        command, "configs",
        lambda *given: {name: [replace(one, **SMALL) for one in group] for name, group in made(*given).items()},
    )  # fmt: skip
    monkeypatch.setattr(command, "SECONDS", 4.0)
    monkeypatch.setattr(command, "ROBOTS", (3,))
    line = ["tables", "learning", "--trainings", "2", "--runs", "2", "--steps", "16", "--maps", "open"]
    line += ["--out", str(tmp_path), "--processes", "1"]
    assert main(line) == 0
    out = capsys.readouterr().out
    assert "open, 3 robots" in out
    assert "all: right of way" in out
    rows = read_rows(tmp_path / "learning" / "rows.jsonl")
    assert len(rows) == 8 + 2 + len(SETTINGS) * (2 + 3 * 2)
    assert main(line) == 0  # nothing is trained or driven again
    assert "agent-steps" not in capsys.readouterr().out
    assert read_rows(tmp_path / "learning" / "rows.jsonl") == rows
    page = (tmp_path / "learning" / "README.md").read_text(encoding="utf-8")
    assert page.startswith("# What learning adds\n\n![learning curves](curves.png)")
    assert (tmp_path / "learning" / "curves.png").stat().st_size > 10_000


def test_wrong_numbers_are_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tables", "learning", "--runs", "2"]) == 2
    assert "--runs 2 must be at least --trainings 5" in capsys.readouterr().err
