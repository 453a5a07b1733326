"""The `render_mode` of every adapter: no picture, an array, or a window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.errors import unknown_name
from warehouse_env.portable import Portable

if TYPE_CHECKING:
    from warehouse_env.simulation.simulator import Simulator

RENDER_MODES = ("rgb_array", "human")


def checked_mode(mode: str | None) -> str | None:
    """Return a render mode; ConfigError for anything but None and RENDER_MODES, WarehouseError without pygame."""
    if mode is None:
        return None
    if not isinstance(mode, str) or mode not in RENDER_MODES:
        raise unknown_name("render_mode", mode, RENDER_MODES)
    from warehouse_env.render.extras import check_frames

    check_frames()
    return mode


def render_fps(config: EnvConfig) -> float:
    """Return the env steps per simulated second [1/s]: pictures shown at this rate run in real time."""
    return 1.0 / (config.time_step * config.action_repeat)


def picture(simulator: Simulator, world: int = 0) -> NDArray[np.uint8]:
    """Return a world's picture uint8[H, W, 3]; the renderer is imported on first use."""
    from warehouse_env.render.frame import draw, scene_of

    return draw(scene_of(simulator, world))


def close_window(mode: str | None) -> None:
    """Close the window that the render mode "human" shows pictures in."""
    if mode == "human":
        from warehouse_env.render.video import close

        close()


class FilmedWorld(Portable):
    """Base of the environments of one world: its simulator, and how it is shown."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES), "render_fps": render_fps(EnvConfig())}
    render_mode: str | None

    def _show(self, simulator: Simulator, render_mode: str | None) -> None:
        self.simulator, self.config, self.render_mode = simulator, simulator.config, checked_mode(render_mode)
        self.metadata = {**self.metadata, "render_fps": render_fps(self.config)}  # type: ignore[misc]

    def render(self) -> NDArray[np.uint8] | None:
        """Return the picture uint8[H, W, 3] ("rgb_array"), or show it ("human") and return None."""
        frame = None if self.render_mode is None else picture(self.simulator)
        if frame is None or self.render_mode == "rgb_array":
            return frame
        from warehouse_env.render.video import show

        show(frame, self.metadata["render_fps"])
        return None

    def close(self) -> None:
        """Close the window, if pictures are shown in one."""
        close_window(self.render_mode)
