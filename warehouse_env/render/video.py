"""Write frames into a video file one by one, so that a long episode needs no memory, or show them in a window."""

import contextlib
import math
import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.files import complete_file
from warehouse_env.render.colours import CONTACT, DEADLOCK, WAITING, mix, robot_colour
from warehouse_env.render.extras import load
from warehouse_env.render.floor import FLOOR

# H.264 in 4:2:0, which every browser and player shows; the index stands first, so that it plays while it loads.
# Colours are converted and labelled by the standard that players assume.
_MP4 = ["-crf", "21", "-preset", "veryfast", "-movflags", "+faststart"]
_MP4 += ["-vf", "scale=out_color_matrix=bt709:flags=accurate_rnd+full_chroma_int+full_chroma_inp"]
_MP4 += ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709", "-color_range", "tv"]
# One palette for all frames keeps the file small. It is made from a leading frame, which is then cut off; without
# dither flat colours stay flat.
_GIF = [
    "-filter_complex",
    "split[a][b];[b]trim=end_frame=1,palettegen[p];[a][p]paletteuse=dither=none:diff_mode=rectangle,"
    "trim=start_frame=1,setpts=PTS-STARTPTS",
]


class VideoWriter(contextlib.ExitStack):
    """Write frames to an .mp4 or .gif file, which appears complete at `close`, or not at all.

    As a context manager it closes at the end, and discards the file on an error. A .gif has 256 colours: those of
    the first frame and of all robots; others are shown by the nearest.
    """

    def __init__(self, path: str | os.PathLike[str], fps: float = 25.0) -> None:
        """Prepare to write to `path` at `fps` frames a second; its folder is made if missing.

        Raises ConfigError for another suffix or a bad fps, WarehouseError if the packages are missing or the file
        cannot be written.
        """
        super().__init__()
        self.path = Path(path)
        if self.path.suffix.lower() not in (".mp4", ".gif"):
            raise ConfigError(f"video file {self.path} must end in .mp4 or .gif")
        if not (math.isfinite(fps) and fps > 0):
            raise ConfigError(f"fps={fps!r} must be a finite number above 0")
        self.fps, self.frames = float(fps), 0
        self._ffmpeg = load("imageio_ffmpeg")
        self._stream: Any = None
        self._shape: tuple[int, ...] | None = None
        self._part: Path | None = self.enter_context(complete_file(self.path))
        self.push(self._end)

    def add(self, frame: NDArray[np.uint8]) -> None:
        """Append a frame uint8[H, W, 3]; all frames have the first one's size. Raises WarehouseError."""
        if self._part is None:
            raise WarehouseError(f"video {self.path} is closed already; open a new VideoWriter")
        if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[2] != 3:
            raise WarehouseError(f"a video frame must be uint8[H, W, 3], not {frame.dtype}{list(frame.shape)}")
        if self._shape is None:
            self._shape = frame.shape
            self._stream = self._open(frame)
        if frame.shape != self._shape:
            raise WarehouseError(f"video frames of {self.path} must all be {self._shape}, not {frame.shape}")
        try:
            self._stream.send(np.ascontiguousarray(_even(frame)))
        except OSError as error:
            raise WarehouseError(f"cannot write {self.path}: the video encoder failed; is the disk full?") from error
        self.frames += 1

    def _end(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the encoder; WarehouseError if it did not finish, or had no frame."""
        part, self._part = self._part, None
        if self._stream is not None:
            self._stream.close()
        if kind is None and (part is None or not self.frames or not _complete(part)):
            raise WarehouseError(f"cannot write {self.path}: it has no frame, or the encoder failed; is the disk full?")

    def _open(self, frame: NDArray[np.uint8]) -> Any:
        height, width, _ = _even(frame).shape
        gif = self.path.suffix.lower() == ".gif"
        try:
            stream = self._ffmpeg.write_frames(
                str(self._part),
                (width, height),
                fps=self.fps,
                codec="gif" if gif else "libx264",
                pix_fmt_out="pal8" if gif else "yuv420p",
                quality=None,
                macro_block_size=1,  # sizes are made even here, never rescaled
                ffmpeg_log_level="error",
                output_params=_GIF if gif else _MP4,
            )
            stream.send(None)
            if gif:
                stream.send(_swatches(_even(frame)))
        except (RuntimeError, OSError) as error:
            raise WarehouseError(f'cannot write {self.path}: no ffmpeg; pip install "warehouse-env[render]"') from error
        return stream


def _complete(part: Path) -> bool:
    """Return whether the encoder finished: a .gif then has its trailer, an .mp4 its index at the front."""
    with part.open("rb") as file:
        if part.suffix.lower() == ".mp4":
            return b"moov" in file.read(64)
        file.seek(max(0, part.stat().st_size - 1))
        return file.read() == b";"


def _even(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Repeat the last row and column where H.264 needs an even size."""
    height, width, _ = frame.shape
    return np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")


def _swatches(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the frame with its lower third striped in colours of later frames."""
    inks = [robot_colour(i) for i in range(24)]
    inks += [mix(ink, FLOOR, 0.35) for ink in inks[:16]]
    inks += [CONTACT, mix(CONTACT, FLOOR, 0.65), mix(CONTACT, FLOOR, 0.3)] * 3
    inks += [WAITING, mix(WAITING, FLOOR, 0.65), DEADLOCK, mix(DEADLOCK, FLOOR, 0.65)]
    result = frame.copy()
    rows = len(frame) - len(frame) // 3
    stripes = np.arange(frame.shape[1]) * len(inks) // frame.shape[1]
    result[rows:] = np.array(inks, dtype=np.uint8)[stripes]
    return result


_shut = False  # by the user, until `close`; a process has one window


def show(frame: NDArray[np.uint8], fps: float) -> None:
    """Show a picture uint8[H, W, 3] until the next one, `fps` a second at most; WarehouseError without a display.

    After the user has shut the window (button, Escape, q), nothing is shown until `close`.
    """
    global _shut
    if _shut:
        return
    pygame = load("pygame")
    size = frame.shape[1::-1]
    try:
        pygame.display.init()
        screen = pygame.display.get_surface()
        if screen is None or screen.get_size() != size:
            screen = pygame.display.set_mode(size)
    except pygame.error as error:
        raise WarehouseError(f'no window can be opened ({error}); use render_mode="rgb_array" instead') from error
    for event in pygame.event.get():
        if event.type == pygame.QUIT or (event.type == pygame.KEYDOWN and event.key in (pygame.K_ESCAPE, pygame.K_q)):
            pygame.display.quit()
            _shut = True
            return
    screen.blit(pygame.image.frombuffer(np.ascontiguousarray(frame), size, "RGB"), (0, 0))
    pygame.display.flip()
    _clock(pygame).tick(fps)


def close() -> None:
    """Close the window; the next picture opens one."""
    global _shut
    load("pygame").display.quit()
    _shut = False


@lru_cache(maxsize=1)
def _clock(pygame: Any) -> Any:
    return pygame.time.Clock()
