"""What docs/ takes from the code: every option with its unit and default, every command's help; and that it builds."""

from __future__ import annotations

import dataclasses
import re
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from train.cli import COMMANDS
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig
from warehouse_env import PLANNERS
from warehouse_env.config import EnvConfig, RewardWeights, RobotSpec, SensorSpec
from warehouse_env.traffic_spec import ErrorBounds, TrafficSpec, UncertaintySpec

ROOT = Path(__file__).parents[2]
SHOWN = (
    EnvConfig, RobotSpec, SensorSpec, RewardWeights, TrafficSpec, ErrorBounds, UncertaintySpec, ReinforceConfig,
    ThreadedPPOConfig, PPOConfig,
)  # fmt: skip


@pytest.fixture
def generated(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the module that makes the tables."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "extensions"))
    import generated

    return generated


@pytest.mark.parametrize("options", SHOWN)
def test_every_option_says_what_it_is(options: type, generated: Any) -> None:
    notes = generated.field_notes(options)
    assert list(notes) == [field.name for field in dataclasses.fields(options)]
    assert [name for name, note in notes.items() if not note] == []


def test_notes_stand_behind_above_and_below_fields(generated: Any) -> None:
    assert generated.field_notes(RobotSpec)["length"] == "[m]"
    above = generated.field_notes(RewardWeights)["path_length"]
    assert above.startswith("per metre driven in any direction.")
    assert above.endswith("way-giving dearer, too")
    own, inherited = (generated.field_notes(ReinforceConfig)[name] for name in ("minibatch", "gamma"))
    assert own.startswith("Rows of one gradient step")
    assert inherited == "Discount of one decision."


def test_tables_have_defaults_as_one_would_write_them(generated: Any) -> None:
    table = generated.options_table(EnvConfig).splitlines()
    assert "| `planner` | `str` | `'pf_aco'` | a name of PLANNERS |" in table
    assert any(line.startswith("| `tasks` | `'lifelong'` or `'one_shot'` | `'lifelong'` |") for line in table)
    assert any(line.startswith("| `robot` | `RobotSpec` | `RobotSpec()` |") for line in table)
    assert any(line.startswith("| `traffic` | `TrafficMode \\| TrafficSpec` | `'none'` |") for line in table)
    assert "on this machine" in generated.options_table(PPOConfig)


@pytest.mark.nightly
def test_it_builds_without_a_warning_and_fetches_nothing(html: Path) -> None:
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


def entry(html: Path, name: str) -> str:
    """Return the reference's entry of a name as text: its signature, and what it says."""
    page = (html / "reference" / "python.html").read_text(encoding="utf-8")
    found = re.search(rf'<dt class="sig[^>]* id="{re.escape(name)}">.*?(?=<dt class="sig|$)', page, re.DOTALL)
    assert found, name
    return " ".join(unescape(re.sub(r"<[^>]*>", "", found[0])).split())


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("warehouse_env.Simulator.put", "pose: ArrayLike, speed: ArrayLike"),
        ("warehouse_env.Simulator.step", "actions: ArrayLike) → NDArray[float32]"),
        ("warehouse_env.VideoWriter", "fps: float = 25.0"),
        ("warehouse_env.parallel_env", "**options: Unpack[WorldOptions]"),
        ("warehouse_env.Simulator.cruise_action", "at full speed (raw: no command at all)."),
        ("warehouse_env.Planner.key", "as stable text: equal keys mean equal plans for equal random numbers."),
        ("warehouse_env.GridMap.legal_moves", "NDArray[bool]"),
    ],
)
def test_the_reference_has_types_and_whole_sentences(name: str, said: str, html: Path) -> None:
    assert said in entry(html, name)
    assert "ndarray[" not in (html / "reference" / "python.html").read_text(encoding="utf-8")
