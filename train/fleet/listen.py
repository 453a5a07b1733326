"""A recorded or live stream of a fleet's messages -> what its vehicles said; live ones are kept as they come."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from train.fleet.broker import Broker
from train.fleet.log import Bad, Entry, log_path, read_log
from train.fleet.messages import LOG, log_line
from train.fleet.received import Fleet
from train.fleet.subscriber import receive
from warehouse_env.errors import ConfigError, LostError, WarehouseError


class Heard(NamedTuple):
    """What was heard, and how it ended."""

    fleet: Fleet
    why: str
    stopped: BaseException | None = None  # what broke it off


def hear_log(given: Path, moved: Callable[[], object] = lambda: None) -> Heard:
    """Take in a log, or the one in a folder; moved: called after each line."""
    fleet = Fleet()
    for _, entry in read_log(log_path(given)):
        fleet.add(entry)
        moved()
    return Heard(fleet, "the log ends")


def hear_broker(
    broker: Broker, interface: str, folder: Path, patience: float, seconds: float | None,
    moved: Callable[[], object] = lambda: None,
) -> Heard:  # fmt: skip
    """Take in what vehicles publish, and write it to FOLDER/messages.jsonl at once; moved: called after each message.

    What breaks it off once something has come, Ctrl-C and a broker that went away among it, is in the result, for all
    that came is to be used.
    """
    path, fleet = folder / LOG, Fleet()
    if path.exists():
        raise ConfigError(f"{path} holds messages already; name another folder with --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8", buffering=1) as file:

            def take(moment: str, entry: Entry | Bad) -> bool:
                if isinstance(entry, Entry) and entry.topic is not None:
                    if fleet.is_stale(entry):
                        return False
                    try:
                        text = json.dumps(entry.payload)
                    except RecursionError:
                        return False
                    file.write(log_line(moment, entry.topic, entry.qos or 0, bool(entry.retain), text))
                fleet.add(entry)
                moved()
                return fleet.gone

            why = receive(broker, interface, take, fleet.gaps.append, patience, seconds)
    except (KeyboardInterrupt, WarehouseError) as error:
        if fleet.messages:
            why = "the broker is gone" if isinstance(error, LostError) else "it was stopped"
            return Heard(fleet, why, error)
        path.unlink(missing_ok=True)
        raise
    except OSError as error:
        raise WarehouseError(f"cannot write {path}: {error.strerror or error}") from None
    if not fleet.messages:
        path.unlink(missing_ok=True)
        raise WarehouseError(f"no vehicle said anything at {broker.name} under {interface}/: {why}")
    return Heard(fleet, why)
