"""Provide short stories of robots: a hand-made one and a driven episode."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.render.conftest import driven
from train.fleet.messages import Message, Names
from train.fleet.orders import Story, story_of
from train.fleet.vehicle import messages_of
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.replay import FLAGS, REWARD_TERMS, Replay

NAMES = Names("ACME", "uagv", datetime(2026, 1, 1, tzinfo=UTC))
ORIGIN = (100.0, -20.0)


@lru_cache(maxsize=1)
def episode_story() -> Story:
    """Return seven robots in a tight hall with contacts between robots and with shelves."""
    return story_of(driven())


def story() -> Story:
    """Return a robot at 1 m/s, a frame per second: 4 m east, a new route 5 m north to its goal, the next route west."""
    places = [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (4, 1), (4, 2), (4, 3), (4, 4), (4, 5), (3, 5), (2, 5)]
    frames = len(places)
    pose = np.zeros((frames, 1, 3), np.float32)
    pose[:, 0, :2] = np.array(places) + 0.5
    pose[4:9, 0, 2], pose[9:, 0, 2] = np.pi / 2, np.pi
    route = np.array([0] * 4 + [1] * 5 + [2] * 3, np.int32)[:, None]
    along = np.array([0, 1, 2, 3, 0, 1, 2, 3, 4, 0, 1, 2], np.float32)[:, None]
    lines = [[(0.5, 0.5), (9.5, 0.5)], [(4.5, 0.5), (4.5, 5.5)], [(4.5, 5.5), (0.5, 5.5)]]
    flags = np.ones((frames, 1), np.uint16)
    flags[9, 0] |= 1 << FLAGS.index("arrived")
    flags[9:, 0] |= 1 << FLAGS.index("loaded")
    grid = GridMap(np.zeros((10, 10), np.bool_), picks=np.array([[4, 4]]), stations=np.array([[4, 0]]), name="plan",
                   origin=ORIGIN)  # fmt: skip
    goal = np.where(route == 2, 40, 44).astype(np.int32)
    nobody, still = np.full((frames, 1), -1, np.int32), np.zeros((frames, 1), np.float32)
    replay = Replay(
        "plan", grid, EnvConfig(num_agents=1, time_step=1.0, max_steps=frames - 1), 0, pose, np.ones_like(still), still,
        goal, flags, nobody, nobody, nobody, np.zeros((frames, 1, len(REWARD_TERMS)), np.float32),
        tuple(np.array(line, np.float32) for line in lines), route, along, np.zeros((frames, 0, 3), np.float32),
        np.zeros((frames, 3), np.int32),
    )  # fmt: skip
    never = np.zeros((frames, 1), np.bool_)
    return Story(replay, np.ones((frames, 1)), never, never)


def sent(of: Story, name: str) -> list[Message]:
    """Return the messages of a topic."""
    return [message for message in messages_of(of, NAMES) if message.topic.endswith(f"/{name}")]


def lines(path: Path) -> list[dict[str, Any]]:
    """Return the entries of a log."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def write_lines(path: Path, entries: list[Any]) -> Path:
    """Write entries to a log."""
    path.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    return path
