"""A small floor and a scene on it, for all picture tests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from warehouse_env.config import RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.frame import Scene


@pytest.fixture
def grid() -> GridMap:
    """10 x 14 cells with one block of shelves in the north-west, at rows 2..3, columns 3..6."""
    occupied = np.zeros((10, 14), dtype=np.bool_)
    occupied[2:4, 3:7] = True
    return GridMap(occupied=occupied, name="small")


@pytest.fixture
def make_scene(grid: GridMap) -> Callable[..., Scene]:
    """Return a maker of scenes with one robot a pose, all alive, untouched and with their goal in the far corner."""

    def make(*poses: tuple[float, float, float], **changes: Any) -> Scene:
        count = len(poses)
        scene = Scene(
            grid=grid,
            robot=RobotSpec(),
            pose=np.array(poses, dtype=np.float32).reshape(-1, 3),
            goal=np.tile(np.array([[9, 13]]), (count, 1)),
            routes=[np.zeros((0, 2), dtype=np.float32)] * count,
            touching=np.zeros(count, dtype=np.bool_),
            alive=np.ones(count, dtype=np.bool_),
            time=12.34,
            text="small",
        )
        return scene._replace(**changes)

    return make
