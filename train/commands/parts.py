"""`warehouse policies` and `warehouse planners`: what there is to choose from, in a line each."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from agents import POLICIES, policy_config
from train.central import CENTRAL, central_config
from train.reporting.report import Table
from train.reporting.rows import Row, RowFile
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.planning import PLANNERS
from warehouse_env.traffic_spec import written_traffic

_NEEDS = {
    "sensor": "predictions", "action_type": "real-valued actions", "action_repeat": "a time of its own to decide in",
}  # fmt: skip


def _show(title: str, rows: Sequence[Row], own: str, json: Path | None) -> None:
    """Print a list of parts, and write its rows; own: how one's own are named."""
    file = RowFile(json)
    file.add(rows)
    shown = tuple(name for name, value in rows[0].items() if isinstance(value, str))
    Table(title, shown, tuple(tuple(row[name] for name in shown) for row in rows), own).print()
    print(file.written())


@dataclass(frozen=True)
class Policies(Checked):
    """List the policies by the names that --policy takes."""

    json: Path | None = None
    """Write the rows of the list to this file as JSON lines."""

    def run(self) -> None:
        """List what each policy is and what it is driven with, unless an option says otherwise."""
        usual = EnvConfig()
        parts = {
            name: (entry.summary, "rules" if entry.weights is None else "trained weights", policy_config(name, usual))
            for name, entry in POLICIES.items()
        } | {name: (entry.summary, "all robots' state", central_config(usual)) for name, entry in CENTRAL.items()}
        rows = [
            {"policy": name, "what it is": summary, "made of": made_of, "driven with": _needs(config)}
            for name, (summary, made_of, config) in parts.items()
        ]
        own = "Also a policy: the folder of a trained one (runs/mine), and your own, FILE.py:CLASS or MODULE:CLASS."
        _show("Policies", rows, own, self.json)


def _needs(config: EnvConfig) -> str:
    """Describe how a config differs from the default."""
    usual, traffic = EnvConfig(), written_traffic(config.traffic_spec)
    texts = [] if traffic == usual.traffic else [f"traffic {traffic}"]
    texts += [text for name, text in _NEEDS.items() if getattr(config, name) != getattr(usual, name)]
    return ", ".join(texts) or "-"


@dataclass(frozen=True)
class Planners(Checked):
    """List the planners by the names that --planner takes."""

    json: Path | None = None
    """Write the rows of the list to this file as JSON lines."""

    def run(self) -> None:
        """List what each planner is, by whom, whether it heeds a cost map, and in the rows its parameters."""
        rows: list[Row] = [
            {
                "planner": name, "what it is": (inspect.getdoc(made) or "").split("\n")[0].rstrip("."),
                "cost map": "yes" if getattr(made, "takes_cost", False) else "no",
                "parameters": list(inspect.signature(made).parameters),
            }
            for name, made in PLANNERS.items()
        ]  # fmt: skip
        own = (
            "A name may carry parameters, as in pf_aco:ants=20; the rows list them (--json). A cost map is what live "
            "routes and routes of several robots ask for. Also a planner: your own, FILE.py:CLASS or MODULE:CLASS."
        )
        _show("Planners", rows, own, self.json)
