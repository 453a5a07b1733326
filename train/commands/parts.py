"""`warehouse policies` and `warehouse planners`: what there is to choose from, in a line each."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

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


@dataclass(frozen=True)
class _Parts(Checked):
    """A list of parts; a subclass says of what."""

    own: ClassVar[str]  # how one's own are named

    json: Path | None = None
    """Write the rows of the list to this file as JSON lines."""

    def run(self) -> None:
        """Print the list, and write its rows."""
        rows = self.rows()
        file = RowFile(self.json)
        file.add(rows)
        shown = [name for name, value in rows[0].items() if isinstance(value, str)]
        cells = tuple(tuple(row[name] for name in shown) for row in rows)
        Table(type(self).__name__, tuple(shown), cells, self.own).print()
        print(file.written())

    def rows(self) -> list[Row]:
        """Return a row a part."""
        raise NotImplementedError


@dataclass(frozen=True)
class Policies(_Parts):
    """List the policies by the names that --policy takes."""

    own = "Also a policy: the folder of a trained one (runs/mine), and your own, FILE.py:CLASS or MODULE:CLASS."

    def rows(self) -> list[Row]:
        """Return a row a policy: what it is and what it is driven with, unless an option says otherwise."""
        usual = EnvConfig()
        parts = {
            name: (entry.summary, "rules" if entry.weights is None else "trained weights", policy_config(name, usual))
            for name, entry in POLICIES.items()
        } | {name: (entry.summary, "all robots' state", central_config(usual)) for name, entry in CENTRAL.items()}
        return [
            {"policy": name, "what it is": summary, "made of": made_of, "driven with": _needs(config)}
            for name, (summary, made_of, config) in parts.items()
        ]


def _needs(config: EnvConfig) -> str:
    """Describe how a config differs from the default."""
    usual, traffic = EnvConfig(), written_traffic(config.traffic_spec)
    texts = [] if traffic == usual.traffic else [f"traffic {traffic}"]
    texts += [text for name, text in _NEEDS.items() if getattr(config, name) != getattr(usual, name)]
    return ", ".join(texts) or "-"


@dataclass(frozen=True)
class Planners(_Parts):
    """List the planners by the names that --planner takes."""

    own = (
        "A name may carry parameters, as in pf_aco:ants=20; the rows list them (--json). A cost map is what live "
        "routes and routes of several robots ask for. Also a planner: your own, FILE.py:CLASS or MODULE:CLASS."
    )

    def rows(self) -> list[Row]:
        """Return a row a planner: what it is, by whom, whether it heeds a cost map, and its parameters."""
        return [
            {
                "planner": name, "what it is": (inspect.getdoc(made) or "").split("\n")[0].rstrip("."),
                "cost map": "yes" if getattr(made, "takes_cost", False) else "no",
                "parameters": list(inspect.signature(made).parameters),
            }
            for name, made in PLANNERS.items()
        ]  # fmt: skip
