"""The user's own parts named on a command line, loaded once here and in each worker process."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from agents import POLICIES, add_policy
from agents.weights_folder import WEIGHTS
from warehouse_env.checked import Checked
from warehouse_env.files import file_digest, whereabouts
from warehouse_env.maps.layouts import add_layout
from warehouse_env.observation import add_sensor
from warehouse_env.planning import add_planner
from warehouse_env.plugins import LOADED, digests
from warehouse_env.simulation.tasks.sampled import add_tasks

Typed = tuple[str, str]
"""A kind of part, and its name as typed."""

_ADD: dict[str, Callable[[str], None]] = {
    "policy": add_policy, "planner": add_planner, "layout": add_layout, "sensor": add_sensor, "tasks": add_tasks,
}  # fmt: skip


@dataclass(frozen=True)
class OwnSensors(Checked):
    """The option for sensors."""

    sensor: tuple[str, ...] = ()
    """Your own sensors that the policies need, under the names they were trained with: FILE.py:CLASS or
    MODULE:CLASS."""


def take_in(typed: Iterable[Typed]) -> None:
    """Put each own part into its registry; ConfigError or WeightsError if it cannot be loaded."""
    for kind, text in typed:
        _ADD[kind](text)


def taken_in() -> list[Typed]:
    """Return all own parts in the registries, for `take_in` in another process."""
    return [(part.kind, name) for name, part in LOADED.items()]


def versions(policy: str, *names: str, orders: str = "") -> dict[str, str]:
    """Return name -> digest of what may change under the same name: a policy's weights, plugins (`names`), orders."""
    found = digests(policy, *names)
    if policy not in POLICIES:
        path = whereabouts(policy)
        weights = path / WEIGHTS if path.is_dir() else path
        if weights.is_file():
            found[policy] = file_digest(weights)
    if orders:
        found[orders] = file_digest(whereabouts(orders))
    return found
