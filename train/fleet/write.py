"""Write an episode as the messages of its fleet, in time order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from train.fleet.factsheet import factsheet_of
from train.fleet.messages import LOG, Message, Names, Sender
from train.fleet.orders import Story
from train.fleet.vehicle import VehicleWriter
from warehouse_env.errors import ConfigError
from warehouse_env.files import complete_file
from warehouse_env.maps.halls.saved import write_hall

FLOOR = "floor.yaml"


def messages_of(
    story: Story, names: Names, every: float | None = None, moved: Callable[[], object] = lambda: None
) -> Iterator[Message]:
    """Yield all messages of a story.

    every: seconds between two visualizations of a vehicle (None: each step). moved: called after each moment.
    """
    step, last = story.replay.seconds, len(story.replay.pose) - 1
    stride = 1 if every is None else round(every / step)
    if stride < 1:
        raise ConfigError(f"--every {every:g} must be at least {step:g}, a step of the episode [s]")
    vehicles = [VehicleWriter(story, robot) for robot in range(story.replay.config.num_agents)]
    senders = [Sender(names, vehicle.serial) for vehicle in vehicles]
    both = list(zip(vehicles, senders, strict=True))
    factsheet = factsheet_of(story.replay.config, stride * step)
    for _, sender in both:
        yield sender.message(0.0, "connection", {"connectionState": "ONLINE"})
        yield sender.message(0.0, "factsheet", factsheet)
    for frame in range(last + 1):
        for vehicle, sender in both:
            for name, body in vehicle.at(frame):
                yield sender.message(frame * step, name, body)
            if frame % stride == 0:
                yield sender.message(frame * step, "visualization", vehicle.where(frame))
        moved()
    for _, sender in both:
        yield sender.message(last * step, "connection", {"connectionState": "OFFLINE"})


def write_log(messages: Iterable[Message], folder: Path) -> int:
    """Write messages to FOLDER/messages.jsonl, completely or not at all; return their number."""
    count = 0
    with complete_file(folder / LOG) as part, part.open("w", encoding="utf-8") as file:
        for message in messages:
            file.write(message.line)
            count += 1
    return count


def write_floor(story: Story, folder: Path) -> str:
    """Write the floor beside the log; return its name for --map."""
    return write_hall(story.replay.grid, folder / FLOOR, resolution=None)
