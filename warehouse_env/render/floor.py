"""The static part of every picture: floor, floor heights, shelves, pick faces and stations. Uses only numpy."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import GridMap

Image = NDArray[np.float32]

FLOOR = (246, 244, 239)
_SEAM = (235, 232, 225)
_PICK = (204, 198, 186)
_STATION = (203, 224, 226)
_STATION_EDGE = (112, 160, 166)
_RACK = (112, 122, 135)
_RACK_EDGE = (88, 97, 110)
_BOX = np.array([(170, 179, 190), (186, 182, 172), (156, 167, 180), (179, 187, 196)], dtype=np.float32)
_RAISED = (224, 168, 104)
_SUNKEN = (120, 160, 205)
_SHADE_DOWN, _SHADE_RIGHT, _SHADE_BLUR = 0.20, 0.14, 0.14  # [m], the shadow that shelves throw
_RIM = 0.06  # [m] of a disc's, that is dark
_DETAIL = 6.0  # [px per cell] below which seams, boxes and pick marks are left out


def scale_for(grid: GridMap, longest: int = 1600, most: float = 16.0) -> float:
    """Return the pixels per metre (at most `most`) at which the floor's longer side has at most `longest` pixels."""
    return min(most, longest / (max(grid.shape) * grid.cell_size))


class _Pixels(NamedTuple):
    """In which cell each row and column of pixels lies, and where."""

    row: NDArray[np.int64]  # [H]
    column: NDArray[np.int64]  # [W]
    across: Image  # [1, W], from the cell's centre line [cells]
    down: Image  # [H, 1]
    cell: float  # [px]

    def of(self, cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return bool[H, W], each pixel's value among those of the cells."""
        return cells[self.row][:, self.column]

    def rounded(self, half: float, corner: float) -> NDArray[np.float32]:
        """Cover in [0, 1] of each pixel by its cell's rounded square of half-side `half` [cells], with a soft edge."""
        x, y = self.across - (half - corner), self.down - (half - corner)
        outside = np.hypot(x.clip(0), y.clip(0)) + np.minimum(np.maximum(x, y), 0) - corner
        cover: NDArray[np.float32] = np.clip(0.5 - outside * self.cell, 0, 1)
        return cover


@lru_cache(maxsize=8)
def floor_image(grid: GridMap, pixels_per_metre: float) -> NDArray[np.uint8]:
    """Draw the floor without robots -> read-only uint8[H, W, 3], north at the top."""
    cell = grid.cell_size * pixels_per_metre
    rows, columns = grid.shape
    # Pixel centres in cells, from the north-west corner.
    v = ((np.arange(max(1, round(rows * cell))) + 0.5) / cell).clip(0, rows - 1e-4)
    u = ((np.arange(max(1, round(columns * cell))) + 0.5) / cell).clip(0, columns - 1e-4)
    row, column = v.astype(np.int64), u.astype(np.int64)
    across = np.abs(u - column - 0.5)[None, :].astype(np.float32)
    down = np.abs(v - row - 0.5)[:, None].astype(np.float32)
    pixels = _Pixels(row, column, across, down, cell)

    image: Image = np.empty((len(v), len(u), 3), dtype=np.float32)
    image[:] = FLOOR
    if cell >= _DETAIL:
        image[np.flatnonzero(np.diff(row)) + 1] = _SEAM
        image[:, np.flatnonzero(np.diff(column)) + 1] = _SEAM
    _tint_heights(image, grid, row, column)
    _paint_endpoints(image, grid, pixels)
    shelf, discs = pixels.of(grid.walls), _cover_by_discs(grid, v, u, 0.0)
    image *= 1 - 0.26 * _shadow(shelf | (discs > 0.5), pixels_per_metre)[..., None]
    _paint_shelves(image, shelf, pixels)
    _blend(image, discs, _RACK_EDGE)
    _blend(image, _cover_by_discs(grid, v, u, _RIM), _BOX[0])
    result = image.round().clip(0, 255).astype(np.uint8)
    result.setflags(write=False)
    return result


def _cover_by_discs(grid: GridMap, v: NDArray[np.float64], u: NDArray[np.float64], less: float) -> Image:
    """Coverage in [0, 1] of each pixel by discs, narrower by `less` [m] but at least half as wide -> float32[H, W].

    v, u: the pixels' centres [cells], down and across from the north-west corner.
    """
    cover: Image = np.zeros((len(v), len(u)), np.float32)
    down, across = grid.shape[0] * grid.cell_size - v * grid.cell_size, u * grid.cell_size  # y and x [m]
    pixel = abs(float(down[0] - down[-1])) / max(len(v) - 1, 1) or grid.cell_size
    for x, y, radius in grid.discs.astype(np.float64):
        wide = max(radius - less, 0.5 * radius)
        rows, columns = np.abs(down - y) <= wide + pixel, np.abs(across - x) <= wide + pixel
        away = np.hypot(down[rows][:, None] - y, across[columns][None, :] - x)
        part = np.ix_(rows, columns)
        cover[part] = np.maximum(cover[part], np.clip(0.5 + (wide - away) / pixel, 0, 1))
    return cover


def _blend(image: Image, cover: NDArray[np.float32], colour: tuple[int, int, int] | NDArray[np.float32]) -> None:
    image += cover[..., None] * (np.asarray(colour, dtype=np.float32) - image)


def _tint_heights(image: Image, grid: GridMap, row: NDArray[np.int64], column: NDArray[np.int64]) -> None:
    """Warm where the floor is raised, cool where sunken; flat floors stay plain."""
    free = grid.height[~grid.occupied]
    relief = grid.height.clip(free.min(), free.max()) - np.median(free)
    span = float(np.abs(relief).max())
    if span > 0.0:
        share = (0.6 / span * relief)[row][:, column].astype(np.float32)
        _blend(image, share.clip(0), _RAISED)
        _blend(image, (-share).clip(0), _SUNKEN)


def _paint_endpoints(image: Image, grid: GridMap, pixels: _Pixels) -> None:
    """Stations as pale rounded pads, pick faces as small dots."""
    station = pixels.of(grid.marked(grid.stations))
    if station.any():
        _blend(image, pixels.rounded(0.43, 0.14) * station, _STATION_EDGE)
        _blend(image, pixels.rounded(0.43 - max(0.05, 0.7 / pixels.cell), 0.10) * station, _STATION)
    pick = pixels.of(grid.marked(grid.picks))
    if pick.any() and pixels.cell >= _DETAIL:
        dot = np.clip(0.5 + (0.09 - np.hypot(pixels.across, pixels.down)) * pixels.cell, 0, 1)
        _blend(image, (dot * pick).astype(np.float32), _PICK)


def _shadow(shelf: NDArray[np.bool_], pixels_per_metre: float) -> NDArray[np.float32]:
    """Shelves moved down and right, with soft edges -> float32[H, W] in [0, 1]."""
    down, right, soft = (round(part * pixels_per_metre) for part in (_SHADE_DOWN, _SHADE_RIGHT, _SHADE_BLUR))
    shade = np.pad(shelf, ((down + soft, soft), (right + soft, soft))).astype(np.float32)
    for axis in (0, 1):
        shade = np.lib.stride_tricks.sliding_window_view(shade, 2 * soft + 1, axis=axis).mean(axis=-1)
    return shade[: shelf.shape[0], : shelf.shape[1]]


def _scatter(row: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a pseudo-random whole number for each cell."""
    mixed = row * 73856093 ^ column * 19349663
    return (mixed ^ mixed >> 7) * 2654435761 >> 16


def _paint_shelves(image: Image, shelf: NDArray[np.bool_], pixels: _Pixels) -> None:
    """Racks from above: a frame, and a box in each cell, in varied tones."""
    image[shelf] = _RACK
    if pixels.cell >= _DETAIL:
        tone = _BOX[_scatter(pixels.row[:, None], pixels.column[None, :]) % len(_BOX)]
        _blend(image, pixels.rounded(0.43, 0.08) * shelf, tone)
        _blend(image, pixels.rounded(0.30, 0.05) * shelf * np.float32(0.2), (255, 255, 255))
    else:
        image[shelf] = _BOX[0]
    inside = shelf.copy()
    inside[1:] &= shelf[:-1]
    inside[:-1] &= shelf[1:]
    inside[:, 1:] &= shelf[:, :-1]
    inside[:, :-1] &= shelf[:, 1:]
    image[shelf & ~inside] = _RACK_EDGE
