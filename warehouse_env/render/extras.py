"""Import the optional packages that pictures need, with one clear sentence if one is missing."""

import importlib
import os
from typing import Any

from warehouse_env.errors import WarehouseError


def load(module: str) -> Any:
    """Import and return an optional module, e.g. "pygame" or "matplotlib.figure".

    Raises WarehouseError if the package is not installed.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # pygame greets on stdout, which may be a table or JSON
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        sentence = f'pictures need the package {package!r}; pip install "warehouse-env[render]"'
        raise WarehouseError(sentence) from error


def check_frames() -> None:
    """Raise WarehouseError if the package that draws pictures is not installed."""
    load("pygame")
