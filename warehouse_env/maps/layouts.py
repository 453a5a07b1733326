"""The named layouts: a catalogue of floors, and tasks on them.

`LAYOUTS` maps a name to the function that makes the floor; a new layout is one more line there.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env import plugins
from warehouse_env.errors import ConfigError, shown
from warehouse_env.maps.generators import aisles, blocks, open_floor, pillars, random_floor, single_lane
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.halls.hall import is_hall, read_floor
from warehouse_env.maps.movingai import read_map


def paper46() -> GridMap:
    """Return the 46 x 46 warehouse of paper 000: four storage zones parted by wide cross corridors.

    This is a reconstruction. The paper prints its map as a picture only; what it gives in numbers are the size, the
    four zones, and the best lengths of its tables 1 and 2. Of all regular arrangements of blocks with 3-cell aisles
    that we searched, this one (shelf blocks of 2 rows x 3 columns, 4 x 3 blocks a zone, corridors of 6 cells, rims of
    3 and 5 cells) holds start-goal pairs of exactly these lengths, within a zone and across zones, with few turns:
    see `NAMED_TASKS["paper46"]`. Stations stand along the rims, picks are all cells beside a block.
    """
    return dataclasses.replace(blocks(46, 46, corridor_stations=False), name="paper46")


def paper46_rough() -> GridMap:
    """Return `paper46` with an uneven floor, to see a planner choose gentle ground (eq. 12 of paper 000).

    In the middle of the west-east corridor the floor is broken: bumps of 0.03 to 0.15 m on its four northern rows;
    the two southern rows are smooth. In the north-south corridor a ramp climbs 0.2 m over its western half, south of
    the centre, and descends as steeply; its eastern half is level. So the straight route of each task in
    `NAMED_TASKS["paper46_rough"]` crosses rough ground, and a gentle one is at most 8 per cent longer.
    """
    return dataclasses.replace(paper46(), height=_rough_heights(), name="paper46_rough")


def _rough_heights() -> NDArray[np.float32]:
    """Return float32[46, 46], the floor heights [m] of `paper46_rough`."""
    height = np.zeros((46, 46), dtype=np.float32)
    # Steps of 7 and 11 modulo 13 scatter 0..12 over the patch: no two neighbours are equal, and no seed is needed.
    row, column = np.mgrid[20:24, 12:34]
    height[20:24, 12:34] = 0.03 + 0.01 * ((7 * row + 11 * column) % 13)
    climb = np.minimum(np.arange(1, 13), np.arange(12, 0, -1))  # cells from the nearer foot, 1..6..1
    height[29:41, 20:23] = (0.2 / 6 * climb)[:, None]
    return height


def narrow() -> GridMap:
    """Return a dense 46 x 46 floor: 11 x 4 shelf blocks of 2 x 9 cells, aisles and rims of 2 cells."""
    floor = blocks(
        46, 46, block_rows=2, block_columns=9, aisle=2, cross=2, zone_rows=11, zone_columns=4, rim_rows=2,
        rim_columns=2, corridor_stations=False,
    )  # fmt: skip
    return dataclasses.replace(floor, name="narrow")


LAYOUTS: dict[str, Callable[..., GridMap]] = {
    "paper46": paper46, "paper46_rough": paper46_rough, "narrow": narrow, "single_lane": single_lane,
    "open": open_floor, "random": random_floor, "aisles": aisles, "blocks": blocks, "pillars": pillars,
}  # fmt: skip


# The shortest paths of the first three are as long as the best of table 1 of paper 000 (26.3848, 26.9706, 27.5563),
# those of the other two as the best of table 2 (59.4264, 62.5980).
NAMED_TASKS: dict[str, dict[str, tuple[Cell, Cell]]] = {
    "paper46": {
        "in_zone_1": ((22, 1), (5, 18)),
        "in_zone_2": ((44, 45), (26, 29)),
        "in_zone_3": ((23, 1), (42, 16)),
        "cross_zone_1": ((1, 0), (37, 41)),
        "cross_zone_2": ((43, 1), (2, 39)),
    },
    "paper46_rough": {
        "broken_corridor": ((22, 6), (22, 39)),
        "ramp": ((25, 22), (43, 22)),
    },
}


def add_layout(text: str) -> None:
    """Load a user's layout, "my_layout.py:hall" or "module:hall", into LAYOUTS; ConfigError if it is none."""
    plugins.add(text, "layout", LAYOUTS)


def make_layout(name: str, **parameters: Any) -> GridMap:
    """Return the named layout, or the floor of a file: MovingAI's NAME.map, map_server's NAME.yaml, or a picture.

    The name may carry parameters, as in "aisles:seed=7,rows=40". ConfigError, with near matches, for an unknown name or
    parameter; MapError for a file that is no map.
    """
    if isinstance(name, str) and name.lower().endswith(".map") and not parameters:
        return read_map(name)
    if is_hall(name) and not parameters:
        return read_floor(name)
    plain = {key: value.item() if isinstance(value, np.generic) else value for key, value in parameters.items()}
    grid = plugins.make(name, "layout", LAYOUTS, plain)
    if not isinstance(grid, GridMap):
        raise ConfigError(f"{name} is no layout: it returned {shown(grid)}, not a GridMap")
    return grid
