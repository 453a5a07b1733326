"""Test the built documentation: text taken from the code, pictures, charts, and pages at several window widths."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.pages import PAGES, ROOT
from tests.render.conftest import CHROMIUM, needs_chromium
from train.cli import COMMANDS, _options, options_of
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig
from warehouse_env import PLANNERS
from warehouse_env.config import EnvConfig, RewardWeights, RobotSpec, SensorSpec
from warehouse_env.traffic_spec import ErrorBounds, TrafficSpec, UncertaintySpec


@pytest.fixture(scope="session")
def html(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the pages and return their folder; a warning fails."""
    for package in ("sphinx", "myst_parser", "furo", "sphinx_copybutton"):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("pages")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", str(folder / "trees")]
    command += [str(ROOT / "docs"), str(folder / "html")]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return folder / "html"


SHOWN = (
    EnvConfig, RobotSpec, SensorSpec, RewardWeights, TrafficSpec, ErrorBounds, UncertaintySpec, ReinforceConfig,
    ThreadedPPOConfig, PPOConfig,
)  # fmt: skip


def extension(name: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a module of docs/extensions."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "extensions"))
    return import_module(name)


@pytest.mark.parametrize("options", SHOWN)
def test_every_option_has_a_note(options: type, monkeypatch: pytest.MonkeyPatch) -> None:
    notes = extension("generated", monkeypatch).field_notes(options)
    assert list(notes) == [field.name for field in dataclasses.fields(options)]
    assert [name for name, note in notes.items() if not note] == []


def test_option_tables_show_defaults_as_code(monkeypatch: pytest.MonkeyPatch) -> None:
    generated = extension("generated", monkeypatch)
    table = generated.options_table(EnvConfig).splitlines()
    assert "| `planner` | `str` | `'pf_aco'` | a name of PLANNERS |" in table
    assert any(line.startswith("| `arrival` | `'pass'` or `'stop'` or `'pose'` | `'pass'` |") for line in table)
    assert any(line.startswith("| `robot` | `RobotSpec` | `RobotSpec()` |") for line in table)
    assert any(line.startswith("| `traffic` | `TrafficMode \\| TrafficSpec` | `'none'` |") for line in table)
    assert "on this machine" in generated.options_table(PPOConfig)


@pytest.mark.nightly
def test_pages_build_without_warning_and_fetch_nothing(html: Path) -> None:
    pages = {path.relative_to(html).as_posix(): path.read_text(encoding="utf-8") for path in html.rglob("*.html")}
    fetched = re.compile(r"<(script|link|img)[^>]*(src|href)=\"https?:")
    assert [name for name, text in pages.items() if fetched.search(text)] == []
    for name in ("model.html", "planners.html"):
        assert "<math" in pages[name]
        assert "$$" not in pages[name]
    commands, options = pages["reference/commands.html"], pages["reference/options.html"]
    assert [name for name in COMMANDS if f"usage: warehouse {name} " not in commands] == []
    assert "train how they avoid each other" in commands
    assert [name for name in PLANNERS if f"<h3>{name}<" not in options] == []


SECTIONS = PAGES["docs/gallery.md"].split("\n## ")[1:]
PICTURES = sorted((ROOT / "docs" / "gallery").iterdir())


def test_gallery_is_under_three_megabytes() -> None:
    assert len(SECTIONS) == len(PICTURES)
    assert sum(path.stat().st_size for path in PICTURES) < 3_000_000


@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.splitlines()[0])
def test_each_gallery_section_has_one_picture_and_its_short_code(section: str) -> None:
    (picture,) = re.findall(r"!\[[^\]]+\]\(gallery/(\w+)\.gif\)", section)
    assert ROOT / "docs" / "gallery" / f"{picture}.gif" in PICTURES
    (code,) = re.findall(r"^```(?:python|sh)\n(.*?)^```", section, re.MULTILINE | re.DOTALL)
    assert re.search(rf'(film\w*\("{picture}\.gif"|--html {picture}\.html)', code)
    assert len([line for line in code.splitlines() if line]) <= 4


@pytest.mark.parametrize("path", [*PICTURES, ROOT / "docs" / "warehouse.gif"], ids=lambda path: path.stem)
def test_pictures_are_small_animations(path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    assert path.stat().st_size < (400_000 if path in PICTURES else 3_000_000)
    with image.open(path) as film:
        assert film.n_frames >= 15
        first = film.convert("RGB").tobytes()
        film.seek(film.n_frames // 2)
        assert film.convert("RGB").tobytes() != first


JOB = yaml.safe_load((ROOT / "docs" / "how_to" / "rayjob.yaml").read_text(encoding="utf-8"))


def test_rayjob_defines_its_volumes() -> None:
    assert (JOB["apiVersion"], JOB["kind"]) == ("ray.io/v1", "RayJob")
    cluster = JOB["spec"]["rayClusterSpec"]
    for group in (cluster["headGroupSpec"], *cluster["workerGroupSpecs"]):
        assert all(isinstance(value, str) for value in group["rayStartParams"].values())
        pod = group["template"]["spec"]
        mounts = {mount["name"] for one in pod["containers"] for mount in one.get("volumeMounts", ())}
        assert mounts <= {volume["name"] for volume in pod.get("volumes", ())}


def test_rayjob_uses_our_command_and_the_pinned_version() -> None:
    pytest.importorskip("ray")
    program, command, *options = JOB["spec"]["entrypoint"].split()
    assert program == "warehouse"
    assert command in COMMANDS
    made = _options(options_of(command), f"warehouse {command}", options)
    assert made.ray == "auto"
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    assert f"ray=={JOB['spec']['rayClusterSpec']['rayVersion']}" in pins


def test_throughput_chart_has_the_texts_of_the_stored_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    chart = extension("throughput", monkeypatch)
    kept = re.findall(r">([^<>]*)</text>", chart.PICTURE.read_text(encoding="utf-8"))
    monkeypatch.setattr(chart, "PICTURE", tmp_path / "again.svg")
    chart.draw()
    assert re.findall(r">([^<>]*)</text>", (tmp_path / "again.svg").read_text(encoding="utf-8")) == kept


WIDTHS = (390, 768, 1024, 1200, 1280, 1440, 1600)  # [px]
DESK = 1024  # [px] at this width and above, tables, code and formulas must fit

# Return the width of the page, the elements beyond the window's right edge (except inside a scrolling box that fits),
# and the boxes that hide a part of their content.
OUTSIDE = """() => {
  const wide = (one) => one.getBoundingClientRect().right > innerWidth + 0.5;
  const scrolls = (one) => ["auto", "scroll"].includes(getComputedStyle(one).overflowX);
  const reached = (one) => {
    while ((one = one.parentElement) && !one.matches("article")) if (scrolls(one) && !wide(one)) return true;
    return false;
  };
  const outside = [...document.querySelectorAll("article *")].filter((one) => wide(one) && !reached(one));
  const hides = (one) => getComputedStyle(one).overflowX !== "visible" && one.scrollWidth > one.clientWidth + 1;
  const hiding = [...document.querySelectorAll("article *")].filter((one) => one.clientWidth > 30 && hides(one));
  const texts = (found) => found.map((one) => one.textContent.trim().slice(0, 60));
  return [document.documentElement.scrollWidth, texts(outside), texts(hiding)];
}"""


@pytest.mark.nightly
@needs_chromium
def test_pages_fit_their_window(html: Path) -> None:
    api = pytest.importorskip("playwright.sync_api")
    faults = []
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        for path in sorted(html.rglob("*.html")):
            page.goto(path.as_uri())
            for width in WIDTHS:
                page.set_viewport_size({"width": width, "height": 900})
                whole, outside, hiding = page.evaluate(OUTSIDE)
                hidden = hiding if width >= DESK else []
                if whole > width or outside or hidden:
                    faults.append(f"{path.relative_to(html)} at {width} px: {whole} px wide, {(outside + hidden)[:3]}")
        browser.close()
    assert not faults, "\n".join(faults)
