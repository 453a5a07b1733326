"""Imports of the optional packages that pictures need, with one clear sentence where one is missing."""

from __future__ import annotations

import importlib
import os
from typing import Any

from warehouse_env.errors import WarehouseError


def load(module: str) -> Any:
    """Import and return an optional module, e.g. "pygame" or "matplotlib.figure".

    Raises WarehouseError where the package is not installed.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # pygame greets on stdout, which may be a table or JSON
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        sentence = f'pictures need the package {package!r}; pip install "warehouse-env[render]"'
        raise WarehouseError(sentence) from error


def check_frames() -> None:
    """Raise WarehouseError where what frames and windows are drawn with is not installed."""
    load("pygame")


def check_window() -> None:
    """Raise WarehouseError where no window can be opened: asked before anything is drawn for one.

    Without a screen SDL draws where nobody sees it, which is refused unless SDL_VIDEODRIVER asks for it.
    """
    pygame = load("pygame")
    try:
        pygame.display.init()
        seen = pygame.display.get_driver() in (os.environ.get("SDL_VIDEODRIVER"), *_ON_SCREEN)
        pygame.display.quit()
    except pygame.error as error:
        raise WarehouseError(f"no window can be opened ({error}); {_INSTEAD}") from error
    if not seen:
        raise WarehouseError(f"no window can be opened, for there is no screen; {_INSTEAD}")


_ON_SCREEN = ("x11", "wayland", "windows", "cocoa", "kmsdrm")
_INSTEAD = "--html FILE or --video FILE shows the same"
