"""The toy study as the only one of the catalogue."""

from __future__ import annotations

import sys
import types

import pytest

from tests.train.tables.toy import STUDY
from train.tables import command
from train.tables.study import Study


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Study:
    """Make the toy study the only one of the catalogue."""
    command.studies_of.cache_clear()
    command.settings_of.cache_clear()
    module = types.ModuleType("toy_paper")
    module.STUDIES = (STUDY,)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "toy_paper", module)
    monkeypatch.setattr(command, "MODULES", {"toy": "toy_paper"})
    return STUDY
