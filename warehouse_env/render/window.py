"""A window that shows pictures at the pace of the episode; pygame has one for the whole process."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import WarehouseError
from warehouse_env.render.extras import load

_shut = False  # by the user, until `close`


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
