"""Test that videos are complete or absent, and that the window shows pictures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from warehouse_env import parallel_env, vec_env
from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.render.colours import robot_colour
from warehouse_env.render.video import VideoWriter, show

imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
pygame = pytest.importorskip("pygame")


def frames(count: int = 12, height: int = 61, width: int = 83) -> Iterator[np.ndarray]:
    """Yield odd-sized frames, the k-th in robot k's colour, each with a white north-west corner."""
    for k in range(count):
        frame = np.full((height, width, 3), robot_colour(k), dtype=np.uint8)
        frame[:10, :10] = 255
        yield frame


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_video_shows_its_frames(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"clip{suffix}"
    with VideoWriter(path, fps=10) as video:
        for frame in frames():
            video.add(frame)
    reader = imageio_ffmpeg.read_frames(str(path))
    meta = next(reader)
    width, height = meta["size"]
    assert (width, height) == (84, 62)
    if suffix == ".mp4":
        assert meta["codec"] == "h264"
        assert meta["pix_fmt"].startswith("yuv420p")
    pictures = [np.frombuffer(data, dtype=np.uint8).reshape(height, width, 3) for data in reader]
    for k in (0, 6, 11):
        assert np.abs(pictures[k][40, 40].astype(int) - robot_colour(k)).max() < 20
        assert pictures[k][4, 4].min() > 230


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_video_cut_short_by_its_encoder_leaves_no_file(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    video = VideoWriter(tmp_path / f"clip{suffix}")
    for frame in frames():
        video.add(frame)
    stream = video._stream

    class Cut:
        def close(self) -> None:
            stream.close()
            part = video_part(tmp_path)
            part.write_bytes(part.read_bytes()[:-40] if suffix == ".gif" else b"ftyp" * 20)

    monkeypatch.setattr(video, "_stream", Cut())
    with pytest.raises(WarehouseError, match="encoder failed"):
        video.close()
    assert list(tmp_path.iterdir()) == []


def video_part(folder: Path) -> Path:
    """Return the only file in a folder, a video in progress."""
    (part,) = folder.iterdir()
    return part


def test_bad_input_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"clip\.avi must end in \.mp4 or \.gif"):
        VideoWriter(tmp_path / "clip.avi")
    with pytest.raises(ConfigError, match="fps"):
        VideoWriter(tmp_path / "clip.mp4", fps=0)
    (tmp_path / "file").write_text("")
    with pytest.raises(WarehouseError, match="cannot write"):
        VideoWriter(tmp_path / "file" / "clip.mp4")
    with VideoWriter(tmp_path / "clip.mp4") as video:
        with pytest.raises(WarehouseError, match="uint8"):
            video.add(np.zeros((8, 8, 3)))
        video.add(np.zeros((8, 8, 3), dtype=np.uint8))
        with pytest.raises(WarehouseError, match="must all be"):
            video.add(np.zeros((8, 10, 3), dtype=np.uint8))
    with pytest.raises(WarehouseError, match="closed already"):
        video.add(np.zeros((8, 8, 3), dtype=np.uint8))


def test_window_shows_pictures_of_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    for height in (61, 61, 40):
        for frame in frames(3, height):
            show(frame, fps=1000)
        window = pygame.display.get_surface()
        assert window.get_size() == (83, height)
        assert window.get_at((20, 20))[:3] == robot_colour(2)
    pygame.display.quit()


def test_one_window_shows_all_worlds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    sizes = {}
    for mode in ("rgb_array", "human"):
        env = vec_env(2, layout="open", num_agents=2, planner="astar", render_mode=mode)
        env.seed(1)
        env.reset()
        shown = env.render()
        sizes[mode] = pygame.display.get_surface().get_size() if shown is None else shown.shape[1::-1]
    assert sizes["human"] == sizes["rgb_array"]
    env.close()
    assert pygame.display.get_surface() is None


@pytest.mark.parametrize("shut", [(pygame.QUIT, {}), (pygame.KEYDOWN, {"key": pygame.K_q})])
def test_window_closed_by_the_user_stays_closed(
    shut: tuple[int, dict[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = parallel_env(layout="open", num_agents=2, planner="astar", render_mode="human")
    env.reset(seed=1)
    assert pygame.display.get_surface() is not None
    pygame.event.post(pygame.event.Event(*shut))
    for _ in range(2):
        env.render()
        assert pygame.display.get_surface() is None
    env.close()
    env.render()
    assert pygame.display.get_surface() is not None
    env.close()
    assert pygame.display.get_surface() is None


def test_missing_display_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "nothing_of_this_name")
    pygame.display.quit()
    with pytest.raises(WarehouseError, match="no window can be opened"):
        show(next(frames()), fps=1000)
