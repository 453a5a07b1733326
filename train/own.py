"""Parts of one's own that a command line names: loaded once, here and in the processes that work for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from agents import POLICIES, add_policy
from agents.weights_folder import WEIGHTS
from warehouse_env.files import file_digest, whereabouts
from warehouse_env.maps.layouts import add_layout
from warehouse_env.planning import add_planner
from warehouse_env.plugins import LOADED, digests

Typed = tuple[str, str]
"""A kind of part, and its name as it was typed."""

_ADD: dict[str, Callable[[str], None]] = {"policy": add_policy, "planner": add_planner, "layout": add_layout}


def take_in(typed: Iterable[Typed]) -> None:
    """Put each part of one's own into its registry; ConfigError or WeightsError where one cannot be loaded."""
    for kind, text in typed:
        _ADD[kind](text)


def taken_in() -> list[Typed]:
    """Return all parts of one's own that are in the registries: what `take_in` needs in another process."""
    return [(part.kind, name) for name, part in LOADED.items()]


def versions(policy: str, planner: str, layout: str, orders: str = "") -> dict[str, str]:
    """Return name -> digest for what is not ours and may change under its name: code, a policy's weights, orders."""
    found = digests(policy, planner, layout)
    if policy not in POLICIES:
        path = whereabouts(policy)
        weights = path / WEIGHTS if path.is_dir() else path
        if weights.is_file():
            found[policy] = file_digest(weights)
    if orders:
        found[orders] = file_digest(whereabouts(orders))
    return found
