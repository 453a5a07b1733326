"""`warehouse policies` and `warehouse planners`: what there is to choose from, in a line each."""

from __future__ import annotations

import inspect
from dataclasses import dataclass

from agents import POLICIES, policy_config
from train.central import CENTRAL, central_config
from train.reporting.report import Table
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.planning import PLANNERS
from warehouse_env.traffic_spec import written_traffic

_NEEDS = {
    "sensor": "predictions", "action_type": "real-valued actions", "action_repeat": "a time of its own to decide in",
}  # fmt: skip


@dataclass(frozen=True)
class Policies(Checked):
    """List the policies by the names that --policy takes."""

    def run(self) -> None:
        """List what each policy is and what it is driven with, unless an option says otherwise."""
        usual = EnvConfig()
        parts = {
            name: (entry.summary, "rules" if entry.weights is None else "trained weights", policy_config(name, usual))
            for name, entry in POLICIES.items()
        } | {name: (entry.summary, "all robots' state", central_config(usual)) for name, entry in CENTRAL.items()}
        cells = ((name, summary, made_of, _needs(config)) for name, (summary, made_of, config) in parts.items())
        own = "Also a policy: the folder of a trained one (runs/mine), and your own, FILE.py:CLASS or MODULE:CLASS."
        Table("Policies", ("policy", "what it is", "made of", "driven with"), tuple(cells), own).print()


def _needs(config: EnvConfig) -> str:
    """Describe how a config differs from the default."""
    usual, traffic = EnvConfig(), written_traffic(config.traffic_spec)
    texts = [] if traffic == usual.traffic else [f"traffic {traffic}"]
    texts += [text for name, text in _NEEDS.items() if getattr(config, name) != getattr(usual, name)]
    return ", ".join(texts) or "-"


@dataclass(frozen=True)
class Planners(Checked):
    """List the planners by the names that --planner takes."""

    def run(self) -> None:
        """List what each planner is, by whom, and whether it heeds a cost map."""
        cells = tuple(
            (
                name, (inspect.getdoc(made) or "").split("\n")[0].rstrip("."),
                "yes" if getattr(made, "takes_cost", False) else "no",
            )
            for name, made in PLANNERS.items()
        )  # fmt: skip
        own = (
            "A name may carry parameters, as in pf_aco:ants=20; a wrong one gets the list. A cost map is what live "
            "routes and routes of several robots ask for. Also a planner: your own, FILE.py:CLASS or MODULE:CLASS."
        )
        Table("Planners", ("planner", "what it is", "cost map"), cells, own).print()
