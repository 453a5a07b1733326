"""Gymnasium's recorders: RecordVideo, with what the extra `render` brings, and RecordEpisodeStatistics."""

from __future__ import annotations

import gymnasium
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics

from warehouse_env import EnvConfig  # whose package registers Warehouse-v0


def test_record_episode_statistics(tiny: EnvConfig) -> None:
    env = RecordEpisodeStatistics(gymnasium.make("Warehouse-v0", config=tiny))
    env.reset(seed=0)
    total, info = 0.0, {}
    for _ in range(tiny.max_steps):
        _, reward, _, truncated, info = env.step(17)
        total += float(reward)
    assert truncated
    assert info["episode"]["l"] == tiny.max_steps
    assert info["episode"]["r"] == pytest.approx(total)
