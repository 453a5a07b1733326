"""Select the client tests whose packages are installed, and give them small environments."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import pytest

from tests.pages import CLIENTS

# Tests whose package is missing are not collected; `make clients` installs all packages.
NEEDS = {
    "test_sweep.py": "ray",  # needs rllib and tune, which the extra `ray` lacks
    "test_torchrl.py": "torchrl",
    "test_benchmarl.py": "benchmarl",
}
INSTALLED = {
    package: find_spec({"ray": "tree"}.get(package, package)) is not None for package in {*NEEDS.values(), *CLIENTS}
}
collect_ignore = [file for file, package in NEEDS.items() if not INSTALLED[package]]


@pytest.fixture
def small() -> dict[str, Any]:
    """Return options for every env factory: three robots on the open floor, forty steps, the fastest planner."""
    return {"layout": "open", "num_agents": 3, "max_steps": 40, "planner": "astar"}
