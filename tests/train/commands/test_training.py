"""Test `warehouse train`: its messages, refusals, resuming, and signals."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.weights_folder import read_record
from tests.maps.halls.test_map_server import YAML, hall, room
from train.cli import main
from train.learning import checkpoint
from train.learning.threaded import ThreadedTrainer
from train.reporting.rows import held
from warehouse_env.config import RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.map_server import write_pgm
from warehouse_env.maps.movingai import write_map

SMALL = (
    "--robots 2 --rows 4 --planner astar --rollout 6 --minibatch 24 --hidden 24 --episode-seconds 3 "
    "--threads 1 --no-progress"
)


def train(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[list[str], list[str]]:
    """Run a short training; return the lines of stdout and stderr."""
    assert main(["train", "reinforce", *SMALL.split(), *words]) == 0
    shown = capsys.readouterr()
    return shown.out.splitlines(), shown.err.splitlines()


def double_the_steps(folder: Path) -> None:
    """Double a finished training's steps, so that half remain."""
    saved = checkpoint.read(folder / "checkpoint")
    longer = saved.data["config"] | {"steps": 2 * saved.data["steps"]}
    checkpoint.write(folder / "checkpoint", saved.arrays, saved.data | {"config": longer})


def test_training_prints_its_start_and_its_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, err = train(capsys, "--layout", "open", "--steps", "48", "--out", str(tmp_path), "--name", "one")
    assert err[0].startswith("trains for 48 agent-steps on open with 2 robots, without the shield and ")
    assert err[0].endswith(f"with live routes, into {tmp_path / 'one'}; Ctrl-C stops and keeps what is learned")
    assert len(out) == 1
    assert out[0].startswith("48 agent-steps in ")
    assert out[0].endswith(f"wrote the policy, its card and its log to {tmp_path / 'one'}")


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("--start nobody", "unknown policy 'nobody'"),
        ("--start greedy", "greedy is a rule without weights"),
        ("--start unshielded", "give its --hidden and --traffic"),
        ("--start unshielded --no-predictions", "is made for sensor="),
        ("--layout open nowhere", "unknown layout 'nowhere'"),
        ("--robots 2 400", "num_agents=400 is too many"),
        ("--planner nobody", "unknown planner 'nobody'"),
        ("--minutes -1", "minutes=-1.0"),
        ("--traffic asist", "did you mean assist"),
        ("--gamma 1.5", "gamma=1.5"),
        ("--rows 0", "rows=0"),
        ("--name a/b", "name='a/b'"),
        ("--layout paper46:seed=new", "layout paper46 takes no parameters; leave out seed"),
        ("--layout aisles:seed=new --traffic none --device cpu", "choose seeds, as in aisles:seed=1"),
        ("--rows 100000", "100,000 rows are for a GPU: add --device cuda, or take fewer --rows"),
        ("--device cpu --planner pf_aco", "does not simulate live routes by pf_aco yet: leave that out"),
    ],
)
def test_wrong_training_options_are_refused_first(
    words: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "reinforce", *SMALL.split(), "--layout", "open", "--out", str(tmp_path), *words.split()]) == 2
    out, err = capsys.readouterr()
    assert err.count("\n") == 1
    assert reason in err
    assert not out
    assert not list(tmp_path.iterdir())


FLOORS = {
    "mine.map": ("mine.map", "mine.oneway"),
    "hall.yaml:keepout=masks/mask.yaml": ("hall.yaml", "hall.pgm", "masks/mask.yaml", "masks/mask.pgm"),
}


def make_floors() -> None:
    """Write the files of all FLOORS into the working folder."""
    write_map(GridMap(np.zeros((12, 16), bool), one_way=np.eye(12, 16, dtype=np.uint8)), "mine.map")
    grey = room(24, 32)
    hall(Path(), grey)
    grey[:, :8] = 0
    Path("masks").mkdir(exist_ok=True)
    write_pgm(grey.astype(np.uint8), Path("masks/mask.pgm"))
    Path("masks/mask.yaml").write_text(YAML.replace("hall.pgm", "mask.pgm"))


@pytest.mark.parametrize("name", FLOORS)
def test_training_resumes_only_on_unchanged_floors(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    make_floors()
    train(capsys, "--layout", name, "--steps", "24", "--out", ".")
    folder = tmp_path / "reinforce"
    double_the_steps(folder)
    again = ["train", "reinforce", "--resume", str(folder), "--no-progress"]
    for file in map(Path, FLOORS[name]):
        before = file.read_bytes()
        file.write_bytes(before + b" ")
        assert main(again) == 2
        assert f"the files of {name} are not those that" in capsys.readouterr().err
        file.write_bytes(before)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert main(again) == 2
    assert f"{name} is missing, a floor of {folder}: resume in the folder where" in capsys.readouterr().err
    monkeypatch.chdir(tmp_path)
    assert main(again) == 0


def test_only_one_process_trains_in_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    train(capsys, "--layout", "open", "--steps", "24", "--out", str(tmp_path), "--name", "mine")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with held(tmp_path / "mine" / ".lock", tmp_path / "mine"):
        for again in (["--resume", str(tmp_path / "mine")], ["--out", str(tmp_path), "--name", "mine"]):
            assert main(["train", "reinforce", *again]) == 2
            message = f"warehouse: {tmp_path / 'mine'} is in use by process {os.getpid()}, since"
            assert capsys.readouterr().err.startswith(message)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("number", "usual", "code"),
    [
        (signal.SIGINT, signal.default_int_handler, 130),
        (signal.SIGINT, signal.SIG_IGN, 130),  # as in a shell's background
        (signal.SIGTERM, signal.SIG_DFL, 143),
    ],
)
def test_stopped_training_prints_how_to_resume(
    number: signal.Signals, usual: Any, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest,
) -> None:  # fmt: skip
    """The signal comes in the first update, before the first row is written."""
    before, update = signal.signal(number, usual), ThreadedTrainer.update
    request.addfinalizer(lambda: signal.signal(number, before))

    def stopped(*arguments: Any) -> dict[str, float]:
        os.kill(os.getpid(), number)
        return update(*arguments)

    monkeypatch.setattr(ThreadedTrainer, "update", stopped)
    words = ["--layout", "open", "--steps", "96", "--out", str(tmp_path / "of us"), "--name", "mine"]
    assert main(["train", "reinforce", *SMALL.split(), *words]) == code
    shown = capsys.readouterr()
    assert shown.err.endswith("\nwarehouse: stopped\n")
    assert signal.getsignal(number) is usual
    out = shown.out.splitlines()
    assert len(out) == 1
    assert out[0].endswith(f"go on with `warehouse train reinforce --resume '{tmp_path / 'of us' / 'mine'}'`")
    monkeypatch.undo()
    assert main(["train", "reinforce", "--resume", str(tmp_path / "of us" / "mine")]) == 0
    assert capsys.readouterr().out.startswith("96 agent-steps")


def test_resumed_training_keeps_its_settings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Cover a checkpoint from before recipes and evaluations, which lacks these options."""
    words = [*SMALL.split(), "--layout", "open", "--steps", "24", "--out", str(tmp_path), "--name", "mine"]
    assert main(["train", "fixed_routes_reinforce", *words]) == 0
    folder = tmp_path / "mine"
    saved = checkpoint.read(folder / "checkpoint")
    old = {name: value for name, value in saved.data["config"].items() if name not in ("evaluation_seconds", "recipe")}
    data = saved.data | {"algorithm": "reinforce", "config": old | {"steps": 48}}
    checkpoint.write(folder / "checkpoint", saved.arrays, data)
    assert main(["train", "reinforce", "--resume", str(folder)]) == 0
    config = read_record(folder).training["config"]
    assert (config["shared"], config["traffic"], config["steps"]) == (0.0, "none", 48)
    assert main(["train", "reinforce", "--resume", str(folder), "--shared", "0.6"]) == 2
    assert "leave out shared=0.6" in capsys.readouterr().err


def test_unwritable_folder_is_refused_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ThreadedTrainer, "__init__", lambda *_: pytest.fail("it plans and compiles first"))
    (tmp_path / "file").touch()
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path)
    for out in (tmp_path / "file", tmp_path / "new"):
        assert main(["train", "reinforce", "--out", str(out)]) == 2
        assert "is no folder that can be written to" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("trainer", ["reinforce", "unshielded", "ppo"])
def test_training_and_resuming_use_the_given_fleet(
    trainer: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if trainer == "ppo":
        pytest.importorskip("stable_baselines3")
    fleet, folder, slow = tmp_path / "fleet.json", tmp_path / trainer, RobotSpec(length=1.2, max_speed=0.8)
    fleet.write_text('[{"share": 1, "robot": {"length": 1.2, "max_speed": 0.8}}]', encoding="utf-8")
    words = ["--layout", "open", "--steps", "48", "--out", str(tmp_path), "--planner", "astar"]
    words += ["--traffic", "none:shield=true", "--fleet", str(fleet)]
    assert main(["train", trainer, *SMALL.split(), *words]) == 0
    kind = "1.2 x 0.6 m, up to 0.8 m/s, braking at 1 m/s²"
    assert f"with 2 robots (of {kind})" in capsys.readouterr().err
    assert kind in (folder / "CARD.md").read_text()
    assert read_record(folder).env.robots == (slow, slow)
    double_the_steps(folder)
    fleet.write_text('[{"share": 1, "robot": {}}]', encoding="utf-8")  # the file is not read again
    assert main(["train", trainer, "--no-progress", "--resume", str(folder), "--fleet", str(fleet)]) == 2
    assert "leave out fleet=" in capsys.readouterr().err
    assert main(["train", trainer, "--no-progress", "--resume", str(folder)]) == 0
    record = read_record(folder)
    assert (record.training["steps"], record.env.robots) == (96, (slow, slow))
