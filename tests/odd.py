"""What must come of any value at all: it works, or one sentence says what is wrong."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

from warehouse_env.errors import MapWarning, WarehouseError


def works_or_says(make: Callable[[], Any]) -> Any:
    """Return what `make` makes, or None where it raises a WarehouseError of one sentence; nothing else may happen."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", MapWarning)  # which says what robots of that size cannot reach
        try:
            return make()
        except WarehouseError as error:
            text = str(error)
            assert text
            assert "\n" not in text
            assert len(text) < 700
            return None
