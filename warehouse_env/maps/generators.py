"""Generators of warehouse floors; each returns a checked GridMap, or raises ConfigError for a bad parameter."""

import itertools

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError, check_count, shown
from warehouse_env.maps.discs import covered
from warehouse_env.maps.endpoints import beside, largest_region
from warehouse_env.maps.grid_map import Cell, GridMap

_RIM = 3  # [cells] least width of the rims of `aisles`
_BLIND = 0.25  # share of its aisles that are closed at one end
LARGEST = 4096  # [cells] of a floor's side, which a robot crosses in an hour


def blocks(
    rows: int = 92, columns: int = 92, *, block_rows: int = 2, block_columns: int = 3, aisle: int = 3, cross: int = 6,
    zone_rows: int = 4, zone_columns: int = 3, rim_rows: int = 3, rim_columns: int = 5, station_spacing: int = 4,
    corridor_stations: bool = True,
) -> GridMap:  # fmt: skip
    """Return a floor of storage zones: regular shelf blocks between aisles, zones between cross corridors.

    rows, columns: size of the floor. block_rows, block_columns: size of a shelf block. aisle: width between blocks.
    zone_rows, zone_columns: blocks in a zone each way. cross: width between zones. rim_rows, rim_columns: least free
    width along the north and south, and along the west and east edge. All in cells; the remainder widens the rims.
    Stations lie along all rims every `station_spacing` cells, off the wall if the rim is 3 wide, and with
    `corridor_stations` along the middle of the north-south cross corridors as well (for floors with many robots).
    Picks are the cells beside a block that are not next to a station. 92 x 92 at these defaults suits 128 robots as
    well as 46 x 46 suits 32, and 260 x 260 suits 1024.
    """
    check_whole(3, rows=rows, columns=columns)
    check_whole(1, block_rows=block_rows, block_columns=block_columns, aisle=aisle, cross=cross, zone_rows=zone_rows)
    check_whole(1, zone_columns=zone_columns, rim_rows=rim_rows, rim_columns=rim_columns)
    check_whole(1, station_spacing=station_spacing)
    if not isinstance(corridor_stations, bool):
        raise ConfigError(f"corridor_stations={shown(corridor_stations)} must be True or False")
    tops = _starts(rows, rim_rows, block_rows, aisle, cross, zone_rows)
    lefts = _starts(columns, rim_columns, block_columns, aisle, cross, zone_columns)
    if not tops or not lefts:
        raise ConfigError(f"rows={rows}, columns={columns} leave no room for a shelf block inside the rims")
    occupied = np.outer(_covered(tops, block_rows, rows), _covered(lefts, block_columns, columns))
    gaps = itertools.pairwise(lefts) if corridor_stations else ()
    middles = [(a + block_columns + b) // 2 for a, b in gaps if b - a - block_columns > aisle]
    offsets = (min(1, (tops[0] - 1) // 2), min(1, (lefts[0] - 1) // 2))
    stations = _stations(rows, columns, offsets, middles, station_spacing)
    return _with_endpoints(occupied, stations, beside(occupied), "blocks")


def _stations(rows: int, columns: int, offsets: tuple[int, int], middles: list[int], spacing: int) -> list[Cell]:
    """Return stations along the rims, and along the columns `middles` of the cross corridors."""
    inner = _spread(offsets[0] + spacing, rows - 1 - offsets[0] - spacing, spacing)
    return rim_stations(rows, columns, offsets, spacing) + [(row, column) for column in middles for row in inner]


def _covered(starts: list[int], block: int, length: int) -> NDArray[np.bool_]:
    """Return which cells along one axis the blocks cover that begin at `starts`."""
    return np.isin(np.arange(length), np.add.outer(starts, np.arange(block)))


def _starts(length: int, rim: int, block: int, aisle: int, cross: int, zone: int) -> list[int]:
    """Return the first cells of the blocks along one axis, centred on it."""
    starts: list[int] = []
    position = rim
    while position + block <= length - rim:
        starts.append(position)
        position += block + (cross if len(starts) % zone == 0 else aisle)
    spare = length - rim - (starts[-1] + block) if starts else 0
    return [start + spare // 2 for start in starts]


def rim_stations(rows: int, columns: int, offsets: tuple[int, int], spacing: int) -> list[Cell]:
    """Return stations every `spacing` cells along the four rims.

    offsets: distance of the stations from the north and south, and from the west and east edge [cells].
    No station lies in a corner, where a robot could hardly turn.
    """
    d_row, d_column = offsets
    west_east = _spread(d_row + 2, rows - 3 - d_row, spacing)
    north_south = _spread(d_column + spacing, columns - 1 - d_column - spacing, spacing)
    cells = [(row, column) for column in (d_column, columns - 1 - d_column) for row in west_east]
    cells += [(row, column) for row in (d_row, rows - 1 - d_row) for column in north_south]
    return list(dict.fromkeys(cells))


def _spread(first: int, last: int, spacing: int) -> list[int]:
    """Return whole numbers from first to last, evenly spread and at least `spacing` apart."""
    if last < first:
        return []
    return [int(number) for number in np.linspace(first, last, (last - first) // spacing + 1).round()]


def single_lane(zone_rows: int = 5, lane: int = 16, rim: int = 4, cross: int = 4) -> GridMap:
    """Return four zones of shelves two deep with one-cell aisles: robots that meet must use a passing place.

    zone_rows: aisles in a zone. lane: their length; in the middle of each a bay, 4 long and 1 deep, is cut out of the
    shelf to its north. rim, cross: width of the rims and of the corridors between zones, at least 3, for a robot needs
    room to turn into an aisle (the north-south corridor is 2 wider). In cells; the defaults give 46 x 46.
    """
    for least, given in ((1, {"zone_rows": zone_rows}), (8, {"lane": lane}), (3, {"rim": rim, "cross": cross})):
        check_whole(least, LARGEST // 8, **given)
    zone_height = 3 * zone_rows + 2
    rows = 2 * (rim + zone_height) + cross
    columns = 2 * (rim + lane) + cross + 2
    occupied = np.zeros((rows, columns), dtype=np.bool_)
    lanes = np.zeros_like(occupied)
    for top in (rim, rim + zone_height + cross):
        for left in (rim, rim + lane + cross + 2):
            occupied[top : top + zone_height, left : left + lane] = True
            bay = slice(left + lane // 2 - 2, left + lane // 2 + 2)
            for row in range(top + 2, top + zone_height, 3):
                occupied[row, left : left + lane] = False
                occupied[row - 1, bay] = False
                lanes[row, left : left + lane] = True
    return _with_endpoints(occupied, rim_stations(rows, columns, (1, 1), 4), lanes, "single_lane")


def open_floor(rows: int = 40, columns: int = 40, spacing: int = 4) -> GridMap:
    """Return a floor without shelves: stations along the rims, picks on an even lattice inside, `spacing` [cells]."""
    check_whole(9, rows=rows, columns=columns)
    check_whole(1, spacing=spacing)
    lattice = np.zeros((rows, columns), dtype=np.bool_)
    lattice[4 : rows - 4 : spacing, 4 : columns - 4 : spacing] = True
    return _with_endpoints(
        np.zeros_like(lattice), rim_stations(rows, columns, (1, 1), max(3, spacing)), lattice, "open"
    )


def random_floor(rows: int = 32, columns: int = 32, share: float = 0.1, seed: int = 0) -> GridMap:
    """Return a floor with shelves on random single cells; cut-off floor is filled, so all floor is one region.

    share: part of the cells that is drawn, 0 to 0.6; seed: the same seed gives the same floor.
    """
    check_whole(1, rows=rows, columns=columns)
    check_whole(0, 2**63 - 1, seed=seed)
    _check_number("share", share, 0.0, 0.6)
    drawn = np.random.default_rng(seed).permutation(rows * columns)[: int(share * rows * columns)]
    occupied = np.zeros(rows * columns, dtype=np.bool_)
    occupied[drawn] = True
    occupied = ~largest_region(~occupied.reshape(rows, columns))
    return GridMap(occupied, name="random")


def aisles(rows: int = 36, columns: int = 44, seed: int = 0) -> GridMap:
    """Return a floor of shelves of random sizes with aisles of one to three cells between them, some of them dead ends.

    Bands of shelves 1 to 5 deep and 2 to 7 long; every row of shelves has aisles of its own, so that most crossings
    are T-shaped; an aisle in four is closed at one end. Stations along the rims, which are 3 wide at least; picks are
    the cells beside a shelf. rows, columns: size of the floor [cells]; seed: the same seed gives the same floor.
    """
    check_whole(12, rows=rows, columns=columns)
    check_whole(0, 2**63 - 1, seed=seed)
    rng = np.random.default_rng(seed)
    occupied = np.zeros((rows, columns), dtype=np.bool_)
    top = _RIM
    while top < rows - _RIM:
        height = min(int(rng.integers(1, 6)), rows - _RIM - top)
        left = _RIM
        while left < columns - _RIM:
            right = min(left + int(rng.integers(2, 8)), columns - _RIM)
            after = right + int(rng.integers(1, 4))
            occupied[top : top + height, left:right] = True
            closed = top + int(rng.integers(0, 2)) * (height - 1)
            if rng.random() < _BLIND and after < columns - _RIM:
                occupied[closed, right:after] = True
            left = after
        top += height + int(rng.integers(1, 4))
    occupied = ~largest_region(~occupied)
    return _with_endpoints(occupied, rim_stations(rows, columns, (1, 1), 4), beside(occupied), "aisles")


def pillars(
    rows: int = 34, columns: int = 40, count: int = 60, radius: float = 0.4, gap: float = 2.4, seed: int = 0
) -> GridMap:
    """Return a hall of round pillars anywhere on its floor, and nothing else.

    rows, columns: size of the floor [cells] of 1 m. count: of pillars, fewer if no more fit. radius: of the
    largest [m]; the smallest is half as wide. gap: least floor between two [m]. seed: the same seed gives the same
    floor. Stations lie along the rims, which no pillar reaches into; picks on an even lattice inside.
    """
    check_whole(16, rows=rows, columns=columns)
    check_whole(1, count=count)
    check_whole(0, 2**63 - 1, seed=seed)
    _check_number("radius", radius, 0.05, 5.0)
    _check_number("gap", gap, 0.0, 100.0)
    rng = np.random.default_rng(seed)
    discs = np.zeros((0, 3))
    for _ in range(20 * count):
        wide = radius * rng.uniform(0.5, 1.0)
        x, y = rng.uniform((_RIM + wide, _RIM + wide), (columns - _RIM - wide, rows - _RIM - wide))
        if len(discs) < count and (np.hypot(*(discs[:, :2] - (x, y)).T) >= discs[:, 2] + wide + gap).all():
            discs = np.concatenate([discs, [(x, y, wide)]])
    closed = covered(discs.astype(np.float32), (rows, columns), 1.0)
    stations, lattice = rim_stations(rows, columns, (1, 1), 4), np.zeros((rows, columns), np.bool_)
    lattice[4 : rows - 4 : 3, 4 : columns - 4 : 3] = True
    floor = _with_endpoints(closed, stations, lattice & largest_region(~closed), "pillars")
    return GridMap(np.zeros_like(closed), picks=floor.picks, stations=floor.stations, name="pillars", discs=discs)


def _with_endpoints(occupied: NDArray[np.bool_], stations: list[Cell], picks: NDArray[np.bool_], name: str) -> GridMap:
    """Return the map with its stations, where free, and with picks on the marked free cells.

    No pick is at or next to a station, so that a robot at one does not block the other.
    """
    free = sorted({cell for cell in stations if not occupied[cell]})
    marked = picks & ~occupied
    for row, column in free:
        marked[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2] = False
    if not free or not marked.any():
        raise ConfigError(f"this {name} floor of {occupied.shape} cells has no room for stations and picks; widen it")
    return GridMap(occupied, picks=np.argwhere(marked), stations=np.array(free), name=name)


def check_whole(least: int, most: int = LARGEST, **given: object) -> None:
    """Raise ConfigError unless the named parameters are whole numbers from `least` to `most`."""
    for what, value in given.items():
        check_count(what, value, least, most)


def _check_number(what: str, value: object, least: float, most: float) -> None:
    """Raise ConfigError unless a parameter is a number from `least` to `most`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= most:
        raise ConfigError(f"{what}={shown(value)} must be a number from {least:g} to {most:g}")
