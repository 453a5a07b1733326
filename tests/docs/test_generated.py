"""What docs/ takes from the code: every option with its unit and default, every command's help; and that it builds."""

from __future__ import annotations

import dataclasses
import re
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
