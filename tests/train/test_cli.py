"""Test the command line: quick help, and one clear sentence with exit code 2 for bad input."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest

from agents import POLICIES
from train import cli
from train.cli import COMMANDS, main
from warehouse_env import __version__
from warehouse_env.errors import LostError
from warehouse_env.maps.layouts import LAYOUTS
from warehouse_env.maps.movingai import EXAMPLE_MAP
from warehouse_env.planning import PLANNERS

DRAW_NOTHING = (
    "bench", "benchmark", "compare", "compile", "demo", "export", "fleet", "layouts", "places", "planners",
    "policies",
)  # fmt: skip
RESULTS = (  # commands whose results are rows
    "advise", "audit", "bench", "benchmark", "clmapf", "compare", "evaluate", "execute", "fleet", "plan",
    "robust", "tables floors", "tables papers", "tables planners",
)  # fmt: skip


def fails(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Run a wrong command line; check exit code and form; return its sentence."""
    assert main(list(arguments)) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("warehouse: ")
    assert shown.err.count("\n") == 1
    assert "Traceback" not in shown.err
    return shown.err.removeprefix("warehouse: ").rstrip()


def test_help_is_quick_and_light() -> None:
    code = (
        "import sys; from train.cli import main; main(['--help']); "
        "heavy = {'torch', 'numba', 'matplotlib', 'pygame', 'stable_baselines3', 'tyro'} & set(sys.modules); "
        "sys.exit(str(heavy) if heavy else 0)"
    )
    begin = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begin
    assert done.returncode == 0, done.stderr
    assert all(f"warehouse {name}" in done.stdout for name in COMMANDS)
    assert seconds < 5  # about 0.3 s on a quiet machine


def test_every_command_has_help_with_the_common_options(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "240")
    for name in COMMANDS:
        assert main([*name.split(), "--help"]) == 0
        shown = capsys.readouterr().out
        assert f"warehouse {name}" in shown
        assert ("--seed" in shown) == (name not in DRAW_NOTHING)
        assert "{None,True,False}" not in shown
        assert not re.search(r"FILE.py:CLASS( or)?\s*\n", shown)  # no line break of the source
        assert ("--json" in shown) == (name in RESULTS)
        listed = re.findall(r"(?m)^\W+--([a-z]+)", shown)
        assert not {"sensor", "processes"}.intersection(listed[:1]) or name == "compile"  # shared by many commands


def test_help_without_a_command_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    for words, shown in (([], "warehouse evaluate"), (["train"], "warehouse train ppo"), (["--version"], __version__)):
        assert main(words) == 0
        assert shown in capsys.readouterr().out


@pytest.mark.parametrize(
    ("command", "line"),
    [
        ("layouts --draw {map} --png {out}/floor.png", "wrote the picture to {out}/floor.png"),
        (
            "plan --layout open --planner astar --tasks 1 --runs 1 --no-pictures --out {out} --json {out}/rows.jsonl",
            "wrote the rows to {out}/rows.jsonl, the table to {out}",
        ),
    ],
)
def test_last_line_lists_the_written_files(
    command: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command.format(out=tmp_path, map=EXAMPLE_MAP).split()) == 0
    assert capsys.readouterr().out.splitlines()[-1] == line.format(out=tmp_path)


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ("evaluat", ["unknown command 'evaluat'", "evaluate"]),
        ("train pppo", ["unknown train command 'pppo'", "ppo"]),
        ("evaluate --policy folow", ["unknown policy 'folow'", "follow"]),
        ("evaluate --policy brake --seconds -5", ["seconds=-5.0", "above 0"]),
        ("evaluate --policy brake --layout open --planner astar --robots 5000", ["num_agents=5000", "fewer robots"]),
        ("evaluate --policy no/such/folder", ["no/such/folder", "policy folder"]),
        ("evaluate --policy brake --map missing.map", ["missing.map"]),
        ("replay episode.npz", ["--html FILE and --video FILE"]),
        ("plan --planner astar --start 3,5 --goal 1,1", ["start (3, 5) is on a shelf"]),
        ("plan --planner astar --start 1,1", ["--goal", "both"]),
        ("plan --runs 0", ["runs=0 must be a whole number from 1"]),
        ("evaluate --policy brake --seconds 1e308", ["seconds=1e+308 must be at most"]),
        ("tables --runs 2", ["unknown tables command '--runs'", "papers"]),
        ("layouts --png picture.png", ["--draw"]),
        ("layouts --draw open --png a.b", ["a.b must end in", ".png"]),
        ("bench --seconds -1", ["seconds=-1.0"]),
        ("demo --video-seconds -1", ["video_seconds=-1.0"]),
        ("train reinforce --robots 0", ["robots=(0,)"]),
        ("evaluate --policy greedy --traffic shiled", ["did you mean shield"]),
        ("evaluate --policy greedy --traffic rules:routes", ["must be PARAMETER=VALUE"]),
        ("evaluate --policy greedy --traffic own:shield=false", ["right_of_way=True must be False without a shield"]),
        ("evaluate --ray auto --processes 2", ["--processes 2 must be left out with --ray"]),
        ("evaluate --ray somewhere", ["--ray 'somewhere' must be auto or HOST:PORT"]),
        ("evaluate --orders none.csv", ["none.csv does not exist"]),
        ("audit", ["name episode files to audit, or policies to drive"]),
        ("audit a.npz --policy greedy", ["name episode files to audit, or policies to drive"]),
        ("audit a.npz --resume", ["--resume must be left out"]),
        ("audit a.npz --disturbance latency", ["--disturbance must be left out"]),
        ("audit nothing.npz", ["nothing.npz does not exist"]),
        ("export --policy greedy --onnx a.onnx", ["a rule without weights"]),
        ("export --policy nowhere --onnx a.onnx", ["unknown policy"]),
        ("fleet", ["one of them"]),
        ("fleet e.npz --layout open", ["goes with --listen"]),
        ("fleet --check x --mqtt h", ["--mqtt goes with an episode"]),
        ("fleet --listen none.jsonl --layout open", ["does not exist"]),
        ("fleet --listen log.jsonl", ["--layout NAME_OR_FILE"]),
        ("fleet none.npz --interface a/#", ["a part of a topic"]),
        ("fleet none.npz --speed 0", ["speed=0.0"]),
        ("fleet none.npz --speed 2", ["--speed goes with --mqtt"]),
        ("live --port 70000", ["from 0 to 65,535"]),
        ("live --robots 257", ["from 1 to 256"]),
        ("live --policy gredy", ["did you mean greedy"]),
        ("live --fleet none.json", ["fleet none.json does not exist"]),
        ("advise", ["name the floor with --layout NAME_OR_FILE"]),
        ("advise --layout open --goals 0", ["goals=0.0 must be a number from 0.001"]),
        ("advise --layout open --policy nobody", ["unknown policy 'nobody'"]),
        ("advise --layout open --episodes 1", ["episodes=1 must be a whole number from 2"]),
        ("advise --layout open --planner nobody", ["unknown planner 'nobody'"]),
        ("advise --layout open --orders nowhere.csv", ["does not exist"]),
        ("tables papers --runs 0", ["runs=0"]),
        ("tables papers --seed -1", ["seed=-1"]),
        ("tables papers --processes 0", ["processes=0"]),
        ("tables papers --papers 999", ["999"]),
        ("tables papers --papers 009", ["unknown paper '009'"]),
        ("benchmark --policy nobody", ["unknown policy 'nobody'"]),
        ("clmapf none", ["none is no folder"]),
        ("compile --processes 0", ["processes=0"]),
        ("places paper46", ["no map of a hall"]),
    ],
)
def test_bad_input_gives_one_sentence(
    arguments: str,
    parts: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    sentence = fails(capsys, *arguments.split())
    assert all(part in sentence for part in parts), sentence
    assert list(tmp_path.rglob("*")) == []  # nothing was written


def test_folder_in_place_of_a_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "is a folder" in fails(capsys, "plan", "--planner", "astar", "--json", str(tmp_path))
    (tmp_path / "file").write_text("")
    for command in ("plan --planner astar", "evaluate --policy brake --planner astar --layout open"):
        sentence = fails(capsys, *command.split(), "--out", str(tmp_path / "file" / "out"))
        assert "table.md" in sentence
        assert "no folder" in sentence
    sentence = fails(capsys, "layouts", "--draw", "open", "--save", str(tmp_path / "file" / "new.map"))
    assert "new.map" in sentence or "file" in sentence


def test_closed_streams_and_ascii_encoding_work(tmp_path: Path) -> None:
    command = f"{shlex.quote(sys.executable)} -m train.cli layouts --draw open --save open.map >&- 2>&-"
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(
        ["sh", "-c", command], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "open.map").read_text().startswith("type octile")


def test_lost_job_has_its_own_exit_code(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def ended(arguments: list[str]) -> int:
        raise LostError("a job is lost")

    monkeypatch.setattr(cli, "_run", ended)
    assert main(["plan"]) == 3
    assert capsys.readouterr().err == "warehouse: a job is lost\n"


@pytest.mark.parametrize(
    ("name", "known", "last"),
    [
        ("layouts", set(LAYOUTS), {}),
        ("policies", set(POLICIES), {
            "greedy": "traffic rules", "follow": "-", "shielded": "traffic assist, predictions",
            **dict.fromkeys(("reinforce", "ppo", "unshielded", "careful"), "traffic routes, predictions"),
        }),
        ("planners", set(PLANNERS), {"astar": "yes", "theta_star": "no"}),
    ],
)  # fmt: skip
def test_parts_are_listed(name: str, known: set[str], last: dict[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name]) == 0
    lines = [[cell.strip() for cell in line.split("│")[1:-1]] for line in capsys.readouterr().out.splitlines()]
    cells = {line[0]: line for line in lines if line}
    assert cells.keys() == known
    assert all(all(line) for line in cells.values())
    assert all(cells[part][-1].endswith(text) for part, text in last.items())


def test_wrong_option_suggests_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "ppo", "--layoot", "open"]) == 2
    message = capsys.readouterr().err
    assert "Perhaps you meant" in message
    assert "--layout" in message
