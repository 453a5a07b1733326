"""The toy study as the only one of the catalogue."""

from __future__ import annotations

import sys
import types

import pytest

from tests.train.tables.toy import STUDY
from train.tables import runner
from train.tables.study import TableStudy


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> TableStudy:
    """Make the toy study the only one of the catalogue."""
    runner.studies_of.cache_clear()
    runner.settings_of.cache_clear()
    module = types.ModuleType("toy_paper")
    module.STUDIES = (STUDY,)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "toy_paper", module)
    monkeypatch.setattr(runner, "PAPERS", {"toy": "toy_paper"})
    return STUDY
