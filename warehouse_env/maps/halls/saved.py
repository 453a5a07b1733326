"""Write a floor for map_server: map and speed mask, with places, one-way cells and discs beside them."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.errors import MapError
from warehouse_env.files import companion
from warehouse_env.maps import discs, one_way
from warehouse_env.maps.grid_map import GridMap, turned
from warehouse_env.maps.halls import places
from warehouse_env.maps.halls.map_server import MOST_PIXELS, YAMLS, Occupancy, write_occupancy


def fineness(grid: GridMap, resolution: float | None) -> int:
    """Return how many pixels of a resolution [m] lie along a cell, 1 if not given; MapError."""
    fine = 1 if resolution is None else round(grid.cell_size / resolution) if resolution > 0 else 0
    if fine < 1 or grid.occupied.size * fine**2 > MOST_PIXELS:
        raise MapError(f"resolution={resolution} must be a share of the cells' {grid.cell_size:g} m, and not too fine")
    return fine


def write_hall(grid: GridMap, path: Path, resolution: float | None = None) -> str:
    """Write a floor as NAME.yaml with its files beside it; return the name that reads it back.

    resolution: [m/pixel], a whole fraction of a cell; by default a pixel a cell. Prices of lanes are lost.
    """
    if path.suffix.lower() not in YAMLS:
        raise MapError(f"{path} must end in {YAMLS[0]}")
    fine = fineness(grid, resolution)
    parameters = [] if grid.cell_size == 1.0 else [f"cell={grid.cell_size:g}"]
    x, y = turned(grid.origin, -grid.yaw).tolist()

    def write(values: NDArray[np.int64], name: Path) -> None:
        pixels = values.repeat(fine, axis=0).repeat(fine, axis=1).astype(np.int8)
        write_occupancy(Occupancy(pixels, grid.cell_size / fine, (x, y), grid.yaw), name)

    write(np.where(grid.walls, 100, 0), path)
    if (speed := grid.speed) is not None:
        parameters.append(f"speed={path.stem}_speed.yaml")
        percent = np.where(np.isfinite(speed), np.clip(speed / RobotSpec.max_speed * 100, 1, 100), 0)
        write(np.rint(percent).astype(np.int64), path.with_name(f"{path.stem}_speed.yaml"))
    discs.write_beside(path, np.column_stack([grid.world(grid.discs), grid.discs[:, 2]]))
    both = zip(places.KINDS, (grid.picks, grid.stations), strict=True)
    listed = {kind: places.places_at(grid.world(grid.centre(cells))) for kind, cells in both}
    places.write_places(listed, companion(path, places.SUFFIX))
    one_way.write_beside(path, grid.one_way)
    return f"{path}:{','.join(parameters)}" if parameters else str(path)
