"""CARD.md of a policy folder: what it was trained on, and for how long."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from agents.weights_folder import PolicyRecord, read_record
from train.kinds import Kinds
from train.learning.config import HELD_OUT_SEED
from train.reporting.report import no_html
from warehouse_env.checked import from_plain
from warehouse_env.files import write_text
from warehouse_env.traffic_spec import written_traffic

CARD = "CARD.md"
_ADVISED = (
    " The untrained policy prefers the fastest command for which the observation predicts no conflict; what training "
    "adds is the difference to that."
)
_END = f"""\
Training seeds lie below {HELD_OUT_SEED:,}, evaluation seeds from there on.

## Measured

Not measured yet: `warehouse evaluate --policy` this folder.

## Limits

One training run in simulation with exact sensing. It lowers collisions, it does not exclude them: a real vehicle needs
its own certified protective field.
"""


def write_card(directory: Path) -> Path:
    """Write the card of the policy in `directory` from its config.json; return its path. WeightsError if it is none."""
    record = read_record(directory)
    name = record.training.get("config", {}).get("name", "policy")
    parts = [f"# {name}", _origin(record), _options(record.training), _END]
    write_text(directory / CARD, "\n\n".join(parts))
    return directory / CARD


def _origin(record: PolicyRecord) -> str:
    env, network, training = record.env, record.network, record.training
    kind = "one of {} commands (speed x offset from the route)" if network.discrete else "{} real-valued commands"
    minutes, steps, updates = training.get("seconds", 0.0) / 60.0, training.get("steps", 0), training.get("updates", 0)
    config = training.get("config", {})
    fleet, start = config.get("fleet"), config.get("start")
    begun = f" It began as the policy {start}." if start else _ADVISED * env.sensor.predictions
    return (
        f"A policy for one robot among many: from its own observation of {network.observation_size} numbers to "
        f"{kind.format(network.actions)} every {env.time_step * env.action_repeat:g} s. Actions are chosen by: "
        f"{record.mode}. It drives with traffic `{written_traffic(env.traffic_spec)}`."
        f"\n\nTrained by {record.algorithm} for {minutes:.1f} minutes: {steps:,} agent-steps in {updates:,} updates"
        f"{f', with {from_plain(Kinds, fleet).words}' if fleet else ''}.{begun}"
    )


def _options(training: dict[str, Any]) -> str:
    lines = ["## How it was trained", "", "| option | value |", "|---|---|"]
    for name, value in training.get("config", {}).items():
        shown = ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
        lines += [f"| {name} | {no_html(shown)} |"] * (name != "out")
    lines += [f"| {name} (version) | {value} |" for name, value in training.get("versions", {}).items()]
    figures = training.get("last_figures", {})
    if figures:
        shown = ", ".join(f"{name} {value:.4g}" for name, value in figures.items() if name != "steps_per_second")
        lines += ["", f"Last figures of the training itself (its own worlds, exploring; they flatter): {shown}."]
    return "\n".join(lines)
