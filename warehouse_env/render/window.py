"""A window that shows frames at the pace of the episode."""

from __future__ import annotations

from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import WarehouseError
from warehouse_env.render.extras import load


class Window:
    """A resizable window, opened by the first frame; once the user closes it (button, Escape, q), it stays closed."""

    def __init__(self, fps: float = 25.0, title: str = "warehouse") -> None:
        """Show at most `fps` frames a second. Raises WarehouseError if pygame is missing."""
        self._pygame = load("pygame")
        self._fps = fps
        self._title = title
        self._screen: Any = None
        self._clock: Any = None
        self.closed = False

    def show(self, frame: NDArray[np.uint8]) -> bool:
        """Show a frame uint8[H, W, 3], waiting for its time; return False once the window is closed.

        Raises WarehouseError if there is no display.
        """
        if self.closed:
            return False
        if self._screen is None:
            self._open(frame.shape[1], frame.shape[0])
        pygame = self._pygame
        for event in pygame.event.get():
            if event.type == pygame.QUIT or (
                event.type == pygame.KEYDOWN and event.key in (pygame.K_ESCAPE, pygame.K_q)
            ):
                self.close()
                return False
        screen = pygame.display.get_surface()  # a new one after a resize
        picture = pygame.image.frombuffer(np.ascontiguousarray(frame), frame.shape[1::-1], "RGB")
        share = min(screen.get_width() / frame.shape[1], screen.get_height() / frame.shape[0])
        size = (max(1, round(frame.shape[1] * share)), max(1, round(frame.shape[0] * share)))
        if size != picture.get_size():
            picture = pygame.transform.smoothscale(picture, size)
        screen.fill((38, 44, 52))
        screen.blit(picture, picture.get_rect(center=screen.get_rect().center))
        pygame.display.flip()
        self._clock.tick(self._fps)
        return True

    def close(self) -> None:
        """Close the window; may be called twice."""
        if self._screen is not None:
            self._pygame.display.quit()
            self._screen = None
        self.closed = True

    def __enter__(self) -> Window:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _open(self, width: int, height: int) -> None:
        pygame = self._pygame
        try:
            pygame.display.init()
            desktop = pygame.display.get_desktop_sizes()[0]
            share = min(1.0, 0.9 * desktop[0] / width, 0.9 * desktop[1] / height)
            size = (max(1, round(width * share)), max(1, round(height * share)))
            self._screen = pygame.display.set_mode(size, pygame.RESIZABLE)
        except pygame.error as error:
            raise WarehouseError(
                f'no window can be opened ({error}); use render_mode="rgb_array" or write a video instead'
            ) from error
        pygame.display.set_caption(self._title)
        self._clock = pygame.time.Clock()
