"""Real clients: which need packages of their own, and what each is given."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import pytest

from tests.pages import CLIENTS

# Left out where its package is not installed: `make clients` has an environment with all of them.
NEEDS = {
    "test_sweep.py": "ray",  # with its parts rllib and tune, which the extra `ray` has not
    "test_torchrl.py": "torchrl",
    "test_benchmarl.py": "benchmarl",
}
INSTALLED = {
    package: find_spec({"ray": "tree"}.get(package, package)) is not None for package in {*NEEDS.values(), *CLIENTS}
}
collect_ignore = [file for file, package in NEEDS.items() if not INSTALLED[package]]


@pytest.fixture
def small() -> dict[str, Any]:
    """Options for any of the env factories: three robots on the open floor, plans in no time, forty steps."""
    return {"layout": "open", "num_agents": 3, "max_steps": 40, "planner": "astar"}
