"""A floor as a building of Open-RMF's traffic editor: NAME.building.yaml, and its drawing NAME.building.png.

Vertices are pixels of the drawing, to the right of and below its upper left corner; a measurement says how wide a pixel
is. Open-RMF's frame begins at that corner, in metres, with y up. A parameter is a pair of its type and its value.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from warehouse_env.files import complete_file, write_text
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.cells import within
from warehouse_env.maps.halls.lanes import of_floor
from warehouse_env.maps.halls.map_server import FREE_GREY, OCCUPIED_GREY, Occupancy
from warehouse_env.maps.halls.places import KINDS
from warehouse_env.maps.halls.saved import fineness

SUFFIX = ".building.yaml"
_PIXEL = 0.05  # [m]
_TEXT, _WHOLE, _NUMBER, _FLAG = 1, 2, 3, 4  # types of parameters
_AT = dict(zip(KINDS, ("pickup_dispenser", "dropoff_ingestor"), strict=True))


def write_building(grid: GridMap, path: Path, resolution: float | None = None) -> str:
    """Write a floor's lanes, speed limits, picks and stations; return the corners as a fleet adapter needs them.

    resolution: [m/pixel] of the drawing, a whole fraction of a cell; by default about _PIXEL. Prices are lost.
    """
    fine = fineness(grid, resolution or grid.cell_size / math.ceil(grid.cell_size / _PIXEL))
    size = grid.cell_size / fine
    drawing = path.with_suffix(".png")
    _draw(grid, fine, drawing)
    vertices, lanes = _graph(grid, size)
    rows, columns = (fine * side for side in grid.shape)
    vertices += [[0, rows, 0, ""], [columns, rows, 0, ""]]  # on no lane: they say how wide a pixel is
    level = {
        "measurements": [[len(vertices) - 2, len(vertices) - 1, {"distance": [_NUMBER, columns * size]}]],
        "vertices": vertices, "lanes": lanes,
    }  # fmt: skip
    text = [
        f"name: {_plain(grid.name)}", "coordinate_system: reference_image", "lifts: {}", "levels:",
        f"  {_plain(grid.name)}:", f"    drawing: {{filename: {_plain(drawing.name)}}}", "    elevation: 0",
    ]  # fmt: skip
    for name, entries in level.items():
        text += [f"    {name}:{'' if entries else ' []'}", *(f"      - {_plain(entry)}" for entry in entries)]
    write_text(path, "\n".join(text) + "\n")
    corners = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)]) * size  # of the floor
    rmf = (corners - (0, rows * size)).round(3).tolist()
    return f"{{{_plain(grid.name)}: {{rmf: {rmf}, robot: {grid.world(corners).round(3).tolist()}}}}}"


def _plain(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)  # which is YAML as well


def _draw(grid: GridMap, fine: int, path: Path) -> None:
    from PIL import Image  # imported late: few commands write pictures

    walls = grid.walls.repeat(fine, axis=0).repeat(fine, axis=1)
    picture = Occupancy(walls.astype(np.int8), grid.cell_size / fine)
    grey = np.where(walls | within(grid.discs.astype(np.float64), picture), OCCUPIED_GREY, FREE_GREY)
    with complete_file(path) as part:
        Image.fromarray(grey.astype(np.uint8)).save(part, "PNG")


def _graph(grid: GridMap, size: float) -> tuple[list[list[Any]], list[list[Any]]]:
    """Return vertices and lanes; size: [m] of a pixel. Two lanes to and fro with the same speed limit become one."""
    floor = of_floor(grid)
    points = grid.local(list(floor.nodes.values())) / size
    points[:, 1] = grid.shape[0] * grid.cell_size / size - points[:, 1]
    places = {
        place.name: (f"{kind[:-1]} {k}", _AT[kind]) for kind in KINDS for k, place in enumerate(floor.places[kind], 1)
    }
    vertices = []
    for node, (x, y) in zip(floor.nodes, points.round(3).tolist(), strict=True):
        name, parameter = places.get(node, ("", ""))
        vertices.append([x, y, 0, name, {parameter: [_TEXT, name]} if name else {}])
    number = {node: k for k, node in enumerate(floor.nodes)}
    speed = {(lane.start, lane.end): lane.speed for lane in floor.lanes}
    lanes = []
    for (start, end), most in speed.items():
        both = speed.get((end, start)) == most
        if not both or number[start] < number[end]:
            about = {
                "bidirectional": [_FLAG, both], "graph_idx": [_WHOLE, 0], "orientation": [_TEXT, ""],
                "speed_limit": [_NUMBER, most if np.isfinite(most) else 0.0],
            }  # fmt: skip
            lanes.append([number[start], number[end], about])
    return vertices, lanes
