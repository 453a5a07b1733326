"""Gymnasium's recorders: RecordVideo, with what the extra `render` brings, and RecordEpisodeStatistics."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics, RecordVideo

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


def test_record_video(tiny: EnvConfig, tmp_path: Path) -> None:
    moviepy = pytest.importorskip("moviepy")
    pytest.importorskip("pygame")
    env = gymnasium.make("Warehouse-v0", render_mode="rgb_array", config=tiny)
    env = RecordVideo(env, str(tmp_path / "videos"), episode_trigger=lambda episode: True, disable_logger=True)
    env.reset(seed=0)
    for _ in range(tiny.max_steps):
        env.step(17)
    picture = env.render()
    env.close()
    (video,) = tmp_path.glob("videos/*.mp4")
    with moviepy.VideoFileClip(str(video)) as clip:
        assert clip.size == list(picture.shape[1::-1])
        assert clip.duration == pytest.approx((1 + tiny.max_steps) / env.metadata["render_fps"], abs=0.01)
