"""Test README and docs/: Python runs, commands parse, and names, figures and links match the code."""

from __future__ import annotations

import ast
import dataclasses
import json
import re
import shlex
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
import tyro

from tests.pages import PAGES, ROOT, SHORTER, Block, command_lines, fenced, python_blocks
from train.cli import COMMANDS, main, options_of
from train.learning.config import TrainingConfig
from warehouse_env import EnvConfig, SensorSpec, Simulator, observation_layout
from warehouse_env.simulation.senses.rewards import REWARD_TERMS
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

PROGRAMS = ("warehouse", "make", "pip", "python", "tensorboard", "jupyter")
PYTHON = python_blocks()
MODEL = PAGES["docs/model.md"]


def section(title: str) -> str:
    """Return the section of the model's page under a heading."""
    return MODEL.split(f"\n## {title}\n")[1].split("\n## ")[0]


@pytest.mark.parametrize("block", [block for block in PYTHON if not block.clients], ids=str)
def test_python_block_runs(
    block: Block, registries: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if re.search("render|matplotlib|draw|VideoWriter|film", block.source):
        pytest.importorskip("matplotlib")
        pytest.importorskip("pygame")
    monkeypatch.chdir(tmp_path)
    # Dataclasses look up their module by name.
    monkeypatch.setitem(sys.modules, "page", type(sys)("page"))
    block.run()
    for written, kept in re.findall(r'(imsave|save|VideoWriter|film)\("(\w+)', block.source):
        assert list(tmp_path.glob(f"{kept}.*")), f"{written} left no {kept}"


def test_each_shortening_matches_one_page() -> None:
    assert all(len({block.page for block in PYTHON if long in block.source}) == 1 for long in SHORTER)


def imported() -> list[tuple[str, str]]:
    """Return (module, name) of all imports from our packages in pages and notebooks."""
    sources = [block.source for block in PYTHON]
    for path in sorted((ROOT / "examples").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        sources += ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    found: set[tuple[str, str]] = set()
    for node in (node for source in sources for node in ast.walk(ast.parse(source))):
        if isinstance(node, ast.ImportFrom):
            found |= {(str(node.module), alias.name) for alias in node.names}
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found.add((node.value.id, node.attr))
    return sorted(pair for pair in found if pair[0].split(".")[0] in ("warehouse_env", "agents", "train"))


@pytest.mark.parametrize(("module", "name"), imported())
def test_pages_import_public_names_by_the_shortest_path(module: str, name: str) -> None:
    if module == "warehouse_env.torchrl":
        pytest.importorskip("torchrl")
    assert hasattr(import_module(module), name) or find_spec(f"{module}.{name}")
    for top in (import_module("warehouse_env"), import_module("agents")):
        if module == top.__name__:
            assert name in top.__all__
        elif module.startswith(top.__name__):
            assert name not in top.__all__, f"from {top.__name__} import {name} is shorter"


@pytest.mark.parametrize("line", sorted(set().union(*map(command_lines, PAGES.values()))))
def test_every_command_parses(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Parse without running; unknown commands, options and values raise SystemExit or an error."""
    program, *words = shlex.split(line)
    assert program in PROGRAMS
    if program == "make":
        targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
        assert words[0] in targets
    elif program == "jupyter":
        assert words[0] == "lab"
        assert (ROOT / words[1]).exists()
    elif words == ["install", "jupyterlab"]:
        assert program == "pip"  # no extra installs it: any notebook program will do
    elif program == "pip":
        assert words[:2] == ["install", "-c"]
        assert words[2].startswith("constraints")
        extras = re.findall(r"[a-z]+", words[3])
        known = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        assert (ROOT / words[2]).is_file()
        assert all(re.search(rf"^{extra} = \[", known, re.MULTILINE) for extra in extras)
    elif program == "python" and words[0] != "-m":  # tests/examples runs the script
        source = (ROOT / words[0]).read_text(encoding="utf-8")
        assert all(f"    {word[2:]}: " in source for word in words if word.startswith("--"))
    elif program == "python":
        assert find_spec(words[1]) is not None
        assert "__main__" in Path(str(find_spec(words[1]).origin)).read_text(encoding="utf-8")  # type: ignore[union-attr]
    elif program == "tensorboard":
        assert words == ["--logdir", str(TrainingConfig().out)]
    elif words[0].startswith("--") or "--help" in words:
        assert main(words) == 0
    else:
        name = next(name for name in COMMANDS if name.split() == words[: len(name.split())])
        options, words = options_of(name), words[len(name.split()) :]
        if "--device" in words:  # the named device may be missing here
            words[words.index("--device") + 1] = "cpu"
        usual = {"default": options.defaults_for(name.split()[-1])} if hasattr(options, "defaults_for") else {}
        parsed = tyro.cli(options, prog=f"warehouse {name}", args=words, **usual)
        assert isinstance(parsed, options)


def folder_map() -> list[str]:
    """Return the paths of the map of folders; folders end in a slash."""
    (block,) = fenced(PAGES["docs/architecture.md"], "text")
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


@pytest.mark.parametrize("path", folder_map())
def test_folder_map_names_existing_paths(path: str) -> None:
    assert (ROOT / path).is_dir() if path.endswith("/") else (ROOT / path).is_file()


def test_folder_map_names_every_code_folder() -> None:
    code = {
        f"{path.parent.relative_to(ROOT).as_posix()}/"
        for package in ("warehouse_env", "agents", "train")
        for path in (ROOT / package).rglob("*.py")
    }
    assert code <= set(folder_map())


def headings(page: str) -> set[str]:
    """Return the anchors of a page's headings."""
    titles = re.findall(r"^#+ (.*)", re.sub(r"^```.*?^```", "", PAGES[page], flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES)
def test_links_and_paths_exist(page: str) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", PAGES[page]):
        if "://" in link:
            continue
        file, _, anchor = link.partition("#")
        path = ((ROOT / page).parent / file).resolve() if file else ROOT / page
        assert path.is_file(), link
        assert not anchor or anchor in headings(path.relative_to(ROOT).as_posix()), link
    for path in re.findall(r"`((?:warehouse_env|agents|train|tests|docs|examples)/[\w/]*(?:\.\w+)?)`", PAGES[page]):
        assert (ROOT / path).exists(), path


def test_index_links_every_page() -> None:
    listed = {f"docs/{name}.md" for block in fenced(PAGES["docs/index.md"], "{toctree}") for name in block.split()}
    assert {*PAGES} - {"README.md", "docs/index.md"} <= listed


def test_observation_table_matches_the_layout() -> None:
    table = dict(re.findall(r"^\| `(\w+)` \| (\d+) \|", section("Observation"), re.MULTILINE))
    slices = observation_layout(EnvConfig(sensor=SensorSpec(predictions=True), traffic="shield", arrival="stop")).slices
    assert {name: int(size) for name, size in table.items()} == {n: s.stop - s.start for n, s in slices.items()}


def test_names_match_the_code() -> None:
    reward = section("Reward")
    assert tuple(re.findall(r"`(\w+)` \(", reward)) == REWARD_TERMS
    work = {"arrival": "stop", "service": ServiceSpec(), "orders": OrderSpec(), "battery": BatterySpec()}
    metrics: set[str] = set()
    for more in (work, {"people": 1}):
        simulator = Simulator(EnvConfig(layout="open", num_agents=1, planner="astar", **more))
        simulator.reset(seed=0)
        metrics |= simulator.episode_metrics().keys()
    named = re.findall(r"`(\w+)`", "\n".join(re.findall(r"^\| (`.*?) \|", section("Metrics"), re.MULTILINE)))
    assert len(named) > 8
    assert set(named) <= metrics
    fields = {field.name for field in dataclasses.fields(EnvConfig)}
    (stepping,) = fenced(PAGES["README.md"], "python")
    (training, *_) = fenced(PAGES["docs/how_to/train.md"], "python")
    assert set(re.findall(r"\b(\w+)=", stepping + training)) & fields >= {"num_agents", "max_steps", "layout"}


README = PAGES["README.md"]


def table_rows(text: str) -> list[str]:
    """Return the lines of all tables of figures, including headings."""
    tables = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    return [line for table in tables if "--:" in table for line in table.splitlines()]


def test_readme_is_short() -> None:
    assert len(README.splitlines()) <= 150
    (example,) = fenced(README, "python")
    assert "parallel_env" in example
    assert len(example.splitlines()) <= 10
    assert {"make demo", "make test"} <= command_lines(README)
    assert "](docs/warehouse.gif)" in README


def test_readme_example_prints_its_stated_output() -> None:
    (example,) = fenced(README, "python")
    runs = [subprocess.run([sys.executable, "-c", example], cwd=ROOT, capture_output=True, text=True) for _ in range(2)]
    assert runs[0].stdout == runs[1].stdout
    assert f"`{runs[0].stdout.strip()}`" in README, runs[0].stderr


def test_readme_figures_are_rows_of_docs() -> None:
    measured = [row for page, text in PAGES.items() if page.startswith("docs/measured/") for row in table_rows(text)]
    assert len(table_rows(README)) > 4
    assert [row for row in table_rows(README) if row not in measured] == []
