"""README does not lie: its Python runs, its commands parse, and its files, names and sizes are those of the code."""

from __future__ import annotations

import dataclasses
import re
import shlex
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
import tyro

from agents import POLICIES
from train.cli import COMMANDS, main, with_values
from train.reporting.rows import read_rows
from warehouse_env import LAYOUTS, PLANNERS, EnvConfig, SensorSpec, Simulator, observation_layout
from warehouse_env.simulation.rewards import REWARD_TERMS

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROGRAMS = ("warehouse", "make", "pip", "python")

# What makes the training example short: one rollout instead of hours.
SHORTER = {"total_timesteps=5_000_000": "total_timesteps=9_216"}


def fenced(language: str) -> list[str]:
    """Return the contents of all code blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


PYTHON = fenced("python")


def command_lines() -> list[str]:
    """Return every command that README names, in a block or within a line."""
    lines = [line.split(" #")[0].strip() for block in fenced("sh") for line in block.splitlines()]
    prose = re.sub(r"^```.*?^```", "", README, flags=re.MULTILINE | re.DOTALL)
    lines += re.findall(r"`((?:warehouse|make|pip|python) [^`]+)`", prose)
    lines += re.findall(r"python -m [\w.]+", README)
    return sorted({line for line in lines if line})


def section(title: str) -> str:
    """Return what stands under a heading, up to the next one of its kind."""
    return re.split(r"^## ", README.split(f"\n## {title}\n")[1], flags=re.MULTILINE)[0]


def run_block(source: str) -> dict[str, Any]:
    """Run a block of README, much shortened; returns its names."""
    for long, short in SHORTER.items():
        source = source.replace(long, short)
    names: dict[str, Any] = {"__name__": "readme"}
    exec(compile(source, "README.md", "exec", dont_inherit=True), names)
    return names


@pytest.fixture
def registries() -> Any:
    """Put back the registries that the recipes add to."""
    with mock.patch.dict(LAYOUTS), mock.patch.dict(PLANNERS), mock.patch.dict(POLICIES):
        yield


@pytest.mark.parametrize("source", PYTHON, ids=[f"block_{number}" for number in range(1, len(PYTHON) + 1)])
def test_the_python_runs(
    source: str, registries: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if "matplotlib" in source:
        pytest.importorskip("matplotlib")
        pytest.importorskip("pygame")
    monkeypatch.chdir(tmp_path)
    # Dataclasses look their module up by its name.
    monkeypatch.setitem(sys.modules, "readme", type(sys)("readme"))
    run_block(source)
    for written, kept in re.findall(r'(imsave|save)\("(\w+)', source):
        assert list(tmp_path.glob(f"{kept}.*")), f"{written} left no {kept}"


def test_the_examples_are_short_ones() -> None:
    stepping, training = PYTHON[:2]
    assert "parallel_env" in stepping
    assert "vec_env" in training
    assert len(stepping.splitlines()) <= 10
    assert len([line for line in training.splitlines() if line]) <= 10
    assert all(sum(long in block for block in PYTHON) == 1 for long in SHORTER)


def test_the_recipes_work_together_from_the_command_line(
    registries: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "readme", type(sys)("readme"))
    before = {*LAYOUTS, *PLANNERS, *POLICIES}
    for source in PYTHON:
        if re.search(r"^(LAYOUTS|PLANNERS|POLICIES)\[", source, re.MULTILINE):
            run_block(source)
    layout, planner, policy = ((set(names) - before).pop() for names in (LAYOUTS, PLANNERS, POLICIES))
    common = f"--layout {layout} --planner {planner} --no-pictures --out {tmp_path}"
    assert main([*f"plan {common} --tasks 3 --runs 1 --json {tmp_path}/plan.jsonl".split()]) == 0
    assert all(row["success"] and row["gap"] == pytest.approx(0) for row in read_rows(tmp_path / "plan.jsonl"))
    drive = f"evaluate {common} --policy {policy} follow --robots 3 --episodes 1 --seconds 20"
    assert main(drive.split()) == 0
    polite, follow = read_rows(tmp_path / "rows.jsonl")
    assert polite["policy"] == policy
    assert 0 < polite["robot_km"] < follow["robot_km"] * 1.5
    assert main(["layouts"]) == 0
    assert layout in capsys.readouterr().out


@pytest.mark.parametrize("line", command_lines())
def test_every_command_is_understood(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Parse, do not run: unknown commands, options and values end in SystemExit or an error."""
    program, *words = shlex.split(line)
    assert program in PROGRAMS
    if program == "make":
        targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
        assert words[0] in targets
    elif program == "pip":
        assert words[:3] == ["install", "-c", "constraints.txt"]
        extras = re.findall(r"[a-z]+", words[3])
        known = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        assert (ROOT / words[2]).is_file()
        assert all(re.search(rf"^{extra} = \[", known, re.MULTILINE) for extra in extras)
    elif program == "python":
        assert words[0] == "-m"
        assert find_spec(words[1]) is not None
        assert "__main__" in Path(str(find_spec(words[1]).origin)).read_text(encoding="utf-8")  # type: ignore[union-attr]
    elif "--help" in words:
        assert main(words) == 0
    else:
        name = next(name for name in COMMANDS if name.split() == words[: len(name.split())])
        options = getattr(import_module(COMMANDS[name].module), COMMANDS[name].options)
        parsed = tyro.cli(options, prog=f"warehouse {name}", args=with_values(options, words[len(name.split()) :]))
        assert isinstance(parsed, options)


def test_the_important_commands_are_named() -> None:
    lines = command_lines()
    assert {"make demo", "make test", "warehouse plan", "python -m train.reinforce", "python -m train.ppo"} <= set(
        lines
    )
    for start in ("warehouse layouts --check", "warehouse plan --map", "warehouse evaluate --map", "pip install -c"):
        assert any(line.startswith(start) for line in lines), start


def house() -> list[str]:
    """Return the paths that the map of the house names, folders with a slash at their end."""
    (block,) = re.findall(r"```text\n(.*?)```", section("The map of the house"), re.DOTALL)
    paths: list[str] = []
    folders: dict[int, str] = {}
    for line in block.splitlines():
        depth, name = len(line) - len(line.lstrip()), line.split()[0]
        path = "".join(folder for level, folder in sorted(folders.items()) if level < depth) + name
        folders = {level: folder for level, folder in folders.items() if level < depth}
        if name.endswith("/"):
            folders[depth] = name
        paths.append(path)
    return paths


@pytest.mark.parametrize("path", house())
def test_the_map_of_the_house_names_what_exists(path: str) -> None:
    assert (ROOT / path).is_dir() if path.endswith("/") else (ROOT / path).is_file()


def test_the_map_of_the_house_names_every_folder_of_code() -> None:
    code = {
        f"{path.parent.relative_to(ROOT).as_posix()}/"
        for package in ("warehouse_env", "agents", "train")
        for path in (ROOT / package).rglob("*.py")
    }
    assert code <= set(house())


def test_links_and_paths_lead_somewhere() -> None:
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", README) if "://" not in link]
    headings = {
        re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in re.findall(r"^#+ (.*)", README, re.M)
    }
    for link in links:
        assert link[1:] in headings if link.startswith("#") else (ROOT / link).is_file(), link
    for path in re.findall(r"`((?:warehouse_env|agents|train|tests)/[\w/]*(?:\.py)?)`", README):
        assert (ROOT / path).exists(), path
    assert "docs/warehouse.png" in links
    assert (ROOT / "docs/warehouse.png").stat().st_size < 300_000


def test_the_observation_table_is_the_layout() -> None:
    table = dict(re.findall(r"^\| `(\w+)` \| (\d+) \|", section("The model"), re.MULTILINE))
    slices = observation_layout(EnvConfig(sensor=SensorSpec(predictions=True), protective_field=True)).slices
    assert {name: int(size) for name, size in table.items()} == {n: s.stop - s.start for n, s in slices.items()}


def test_names_are_those_of_the_code() -> None:
    model = section("The model")
    reward = model.split("**Reward.**")[1].split("**Metrics**")[0]
    assert tuple(re.findall(r"`(\w+)` \(", reward)) == REWARD_TERMS
    metrics = Simulator(EnvConfig(layout="open", num_agents=1, planner="astar"))
    metrics.reset(seed=0)
    named = re.findall(r"`(\w+)`", "\n".join(re.findall(r"^\| (`.*?) \|", model.split("**Metrics**")[1], re.MULTILINE)))
    assert len(named) > 8
    assert set(named) <= set(metrics.episode_metrics())
    fields = {field.name for field in dataclasses.fields(EnvConfig)}
    assert set(re.findall(r"\b(\w+)=", "".join(PYTHON[:2]))) & fields >= {"num_agents", "max_steps", "planner"}
