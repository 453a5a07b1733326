"""The `render_mode` of every adapter: no picture, an array, or a window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.errors import unknown_name
from warehouse_env.portable import Portable

if TYPE_CHECKING:
    from warehouse_env.render.window import Window
    from warehouse_env.simulation.simulator import Simulator

RENDER_MODES = ("rgb_array", "human")


def render_fps(config: EnvConfig) -> float:
    """Return the env steps per simulated second [1/s]: pictures shown at this rate run in real time."""
    return 1.0 / (config.time_step * config.action_repeat)


class Camera(Portable):
    """Shows one world of a Simulator in the mode it was built for; renderers are imported on first use."""

    bound = ("_window",)

    def __init__(self, mode: str | None, fps: float) -> None:
        """Remember the mode (None, "rgb_array" or "human"); any other raises ConfigError.

        WarehouseError if a needed package is not installed: now, not at the first picture.
        """
        if mode is not None and (not isinstance(mode, str) or mode not in RENDER_MODES):
            raise unknown_name("render_mode", mode, RENDER_MODES)
        if mode is not None:
            from warehouse_env.render.extras import check_frames

            check_frames()
        self.mode = mode
        self._fps = fps
        self._bind()

    def _bind(self) -> None:
        """Start without a window; the first picture opens it."""
        self._window: Window | None = None

    def shot(self, simulator: Simulator, world: int = 0) -> NDArray[np.uint8] | None:
        """Return the world's picture uint8[H, W, 3], or show it in the window and return None."""
        if self.mode is None:
            return None
        from warehouse_env.render.frame import draw, scene_of

        frame = draw(scene_of(simulator, world))
        if self.mode == "rgb_array":
            return frame
        if self._window is None:
            from warehouse_env.render.window import Window

            self._window = Window(fps=self._fps)
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Close the window, if one is open."""
        if self._window is not None:
            self._window.close()
            self._window = None


class FilmedWorld(Portable):
    """Base of the environments of one world: its simulator, and how it is shown."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES), "render_fps": render_fps(EnvConfig())}
    render_mode: str | None

    def _show(self, simulator: Simulator, render_mode: str | None) -> None:
        self.simulator, self.config, self.render_mode = simulator, simulator.config, render_mode
        self.metadata = {**self.metadata, "render_fps": render_fps(self.config)}  # type: ignore[misc]
        self._camera = Camera(render_mode, self.metadata["render_fps"])

    def render(self) -> NDArray[np.uint8] | None:
        """Return the picture uint8[H, W, 3] ("rgb_array"), or show it ("human") and return None."""
        return self._camera.shot(self.simulator)

    def close(self) -> None:
        """Close the window, if one is open."""
        self._camera.close()
