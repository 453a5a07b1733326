"""Gymnasium's recorders: RecordVideo (with moviepy) and RecordEpisodeStatistics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics, RecordVideo
from moviepy import VideoFileClip

import warehouse_env  # noqa: F401  # registers Warehouse-v0


def test_record_episode_statistics(small: dict[str, Any]) -> None:
    env = RecordEpisodeStatistics(gymnasium.make("Warehouse-v0", **small))
    env.reset(seed=0)
    total, info = 0.0, {}
    for _ in range(small["max_steps"]):
        _, reward, _, truncated, info = env.step(17)
        total += float(reward)
    assert truncated
    assert info["episode"]["l"] == small["max_steps"]
    assert info["episode"]["r"] == pytest.approx(total)


def test_record_video(small: dict[str, Any], tmp_path: Path) -> None:
    env = gymnasium.make("Warehouse-v0", render_mode="rgb_array", **small)
    env = RecordVideo(env, str(tmp_path / "videos"), episode_trigger=lambda episode: True, disable_logger=True)
    env.reset(seed=0)
    for _ in range(small["max_steps"]):
        env.step(17)
    picture = env.render()
    env.close()
    (video,) = tmp_path.glob("videos/*.mp4")
    with VideoFileClip(str(video)) as clip:
        assert clip.size == list(picture.shape[1::-1])
        assert clip.duration == pytest.approx(small["max_steps"] * 0.1 * env.unwrapped.config.action_repeat, rel=0.05)
