"""Which studies there are: those of every paper's module."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from functools import cache

from train.tables.study import Setting, Study
from warehouse_env.errors import unknown_name

MODULES = {number: f"train.tables.papers.paper{number}" for number in ("000", "001", "002", "003", "004")}


@cache
def studies_of(module: str) -> dict[str, Study]:
    """Return the studies of a module by name."""
    return {study.name: study for study in importlib.import_module(module).STUDIES}


@cache
def settings_of(module: str, study: str) -> dict[str, Setting]:
    """Return the settings of a study by name, built once in a process."""
    return {setting.name: setting for setting in studies_of(module)[study].settings()}


def chosen(papers: Sequence[str], tables: Sequence[str]) -> list[tuple[str, Study]]:
    """Return (module, study) of the named papers and tables, all if none are named; WarehouseError for a wrong name."""
    for paper in papers:
        if paper not in MODULES:
            raise unknown_name("paper", paper, MODULES)
    every = [(key, module, study) for key, module in MODULES.items() for study in studies_of(module).values()]
    for table in tables:
        if table not in {study.name for _, _, study in every}:
            raise unknown_name("table", table, {study.name for _, _, study in every})
    return [
        (module, study)
        for key, module, study in every
        if (not papers and not tables) or key in papers or study.name in tables
    ]
