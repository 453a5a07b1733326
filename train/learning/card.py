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

CARD = "CARD.md"
_MEASURE = "## Measured\n\nNot measured yet: `warehouse evaluate --policy` this folder."
_LIMITS = (
    "## Limits\n\nOne training run in simulation with exact sensing. It lowers collisions, it does not exclude them: a "
    "real vehicle needs its own certified protective field."
)


def write_card(directory: Path) -> Path:
    """Write the card of the policy in `directory` from its config.json; return its path. WeightsError if it is none."""
    record = read_record(directory)
    parts = [f"# {record.algorithm}", _origin(record), _settings(record), _MEASURE, _LIMITS]
    write_text(directory / CARD, "\n\n".join(parts) + "\n")
    return directory / CARD


def _origin(record: PolicyRecord) -> str:
    training = record.training
    config = training.get("config", {})
    minutes, steps = training.get("seconds", 0.0) / 60.0, training.get("steps", 0)
    decision = record.env.time_step * config.get("action_repeat", record.env.action_repeat)
    sentences = (
        f"A policy for one robot among many, from its own observation of {record.network.observation_size} numbers to "
        f"{_action(record)}.",
        f"Trained by `{record.algorithm}` for {minutes:.1f} minutes on {config.get('threads')} threads: {steps:,} "
        f"agent-steps in {training.get('updates', 0):,} updates, seed {config.get('seed')}, on the layouts "
        f"{_list(config.get('layouts'))} with {_list(config.get('robots'))} robots{_kinds(config)}, routes by "
        f"`{config.get('planner') or record.env.planner}`, a decision every {decision:g} s, episodes of "
        f"{config.get('episode_seconds')} s (worlds that jammed for {config.get('jam_seconds')} s ended early), "
        f"{_under(record)}.",
        _start(record),
        f"Training seeds lie below {HELD_OUT_SEED:,}, evaluation seeds from there on.",
        f"Actions are chosen by: {record.mode}.",
    )
    return " ".join(sentence for sentence in sentences if sentence)


def _kinds(config: dict[str, Any]) -> str:
    """Say of which kinds the robots were, where they were of others than RobotSpec's own."""
    return f" (of {from_plain(Kinds, config['fleet']).words})" if config.get("fleet") else ""


def _under(record: PolicyRecord) -> str:
    traffic = record.env.traffic_spec
    shield = "under the shield" if traffic.shield else "without a shield"
    trained = shield + (" and with live routes" if traffic.routes else "")
    after = traffic.right_of_way_after
    ring = f"around robots that wait for each other in a ring and have stood for {after:g} s"
    where = ring if after else "everywhere"
    return f"{trained}; driven with right of way {where}" if traffic.right_of_way else trained


def _start(record: PolicyRecord) -> str:
    if not record.env.sensor.predictions:
        return ""
    return (
        "Before the training the policy was set by hand to prefer the fastest command for which the observation "
        "predicts no conflict; what the training adds is the difference to that."
    )


def _action(record: PolicyRecord) -> str:
    env, decision = record.env, record.env.time_step * record.env.action_repeat
    if record.network.discrete:
        what = f"one of {record.network.actions} commands (speed x offset from the route)"
    else:
        what = f"a {env.action_type} command of {record.network.actions} numbers"
    return f"{what} every {decision:g} s"


def _settings(record: PolicyRecord) -> str:
    training = record.training
    lines = ["## How it was trained", "", "| option | value |", "|---|---|"]
    config = training.get("config", {})
    lines += [f"| {name} | {no_html(str(value))} |" for name, value in config.items() if name not in ("out",)]
    lines += [f"| {name} (version) | {value} |" for name, value in training.get("versions", {}).items()]
    figures = training.get("last_figures", {})
    if figures:
        shown = ", ".join(f"{name} {value:.4g}" for name, value in figures.items() if name != "steps_per_second")
        lines += ["", f"Last figures of the training itself (its own worlds, exploring; they flatter): {shown}."]
    return "\n".join(lines)


def _list(values: Any) -> str:
    return ", ".join(no_html(str(value)) for value in values or ("?",))
