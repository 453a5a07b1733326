"""`warehouse policies` and `warehouse planners`: what there is to choose from, in a line each."""

from __future__ import annotations

import inspect
from dataclasses import dataclass

from agents import POLICIES, policy_config
from train.reporting.report import Table
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.planning import PLANNERS
from warehouse_env.traffic_spec import written_traffic


@dataclass(frozen=True)
class Policies(Checked):
    """List the policies by the names that --policy takes."""

    def run(self) -> None:
        """List what each policy is and what it is driven with, unless an option says otherwise."""
        cells = (
            (name, one.summary, "rules" if one.weights is None else "trained weights", _needs(name))
            for name, one in POLICIES.items()
        )
        own = "Also a policy: the folder of a trained one (runs/mine), and your own, FILE.py:CLASS or MODULE:CLASS."
        Table("Policies", ("policy", "what it is", "made of", "driven with"), tuple(cells), own).print()


def _needs(policy: str) -> str:
    """Describe what a policy is driven with."""
    config = policy_config(policy, EnvConfig())
    traffic, predictions = written_traffic(config.traffic_spec), config.sensor.predictions
    return ", ".join([f"traffic {traffic}"] * (traffic != EnvConfig.traffic) + ["predictions"] * predictions) or "-"


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
