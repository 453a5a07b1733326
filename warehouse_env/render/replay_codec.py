"""Pack replays into few bytes: whole numbers of a unit, differences in time, byte planes, deflated or not.

The browser unpacks them (page/data.js). Positions are kept to 2 mm or a 26,000th of the floor, headings to an 8,192nd
of a turn; speeds, steering and rewards to a 127th of their largest value, preferences to a 63rd.
"""

import zlib
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.replay import REWARD_TERMS, Replay

Whole = NDArray[np.int64]
FINEST = 0.002  # [m], of positions
_STEPS = 26_000  # of the floor's longer side, where that is coarser
_TURN = 8_192  # steps of a full turn
_EIGHT_BIT = 127
_SHARES = 63


class Column(NamedTuple):
    """An array of whole numbers, time last, each times `unit`; kept as differences of an order, in `width` bytes."""

    name: str
    values: Whole
    order: int
    width: int
    unit: float = 1.0


def packed(replay: Replay) -> tuple[list[dict[str, Any]], bytes]:
    """Return a replay's columns as a description (name, shape, order, width, unit, signed) and deflated bytes."""
    about, data = laid_out(columns_of(replay))
    return about, zlib.compress(data, 9)


def laid_out(columns: Iterable[Column]) -> tuple[list[dict[str, Any]], bytes]:
    """Return a description of columns (name, shape, order, width, unit, signed), and their bytes end to end."""
    columns = list(columns)
    about = [
        {
            "name": c.name, "shape": c.values.shape, "order": c.order, "width": c.width, "unit": c.unit,
            "signed": bool((c.values < 0).any()),
        }
        for c in columns
    ]  # fmt: skip
    return about, b"".join(map(_bytes, columns))


def position_unit(grid: GridMap) -> float:
    """Return the resolution [m] of positions on a floor."""
    return max(FINEST, max(grid.shape) * grid.cell_size / _STEPS)


def columns_of(replay: Replay) -> Iterator[Column]:
    """Yield a replay's columns: [N, F] by robot and moment, or [N, A, F]; [K] of the routes' points and the floor."""
    yield from moment_columns(replay)
    for k, term in enumerate(REWARD_TERMS):
        yield _scaled(f"reward {term}", replay.rewards[..., k], 0)
    if replay.liked is not None:
        shares = np.moveaxis(replay.liked, 0, -1)  # [N, A, F]
        yield Column("liked", _steps(shares, 1 / _SHARES, moved=False), 0, 1, 1 / _SHARES)
    yield from route_columns(replay.routes, replay.grid)
    yield from floor_columns(replay.grid)


def moment_columns(replay: Replay) -> Iterator[Column]:
    """Yield the states of robots and people at each moment, and the totals: [N, F]."""
    unit = position_unit(replay.grid)
    yield from (Column(name, _steps(replay.pose[..., k], unit), 2, 2, unit) for k, name in enumerate("xy"))
    turn = 2 * np.pi / _TURN
    yield Column("heading", _steps(replay.pose[..., 2], turn) % _TURN, 2, 2, turn)
    yield _scaled("speed", replay.speed, 1)
    yield _scaled("steer", replay.steer, 1)
    yield Column("along", _steps(replay.along, unit), 1, 4, unit)
    for name in ("goal", "route", "waits_for", "yields_to", "held_by"):
        yield _names(name, getattr(replay, name).T)
    yield from (
        Column(f"person_{name}", _steps(replay.people[..., k], unit), 2, 2, unit) for k, name in enumerate("xy")
    )
    yield Column("person_heading", _steps(replay.people[..., 2], turn) % _TURN, 2, 2, turn)
    yield _names("flags", replay.flags.T)
    yield Column("totals", replay.totals.T.astype(np.int64), 1, 4)
    if replay.ends is not None:
        yield from _end_columns(replay.ends, unit)


def _end_columns(ends: NDArray[np.float32], unit: float) -> Iterator[Column]:
    """Yield the poses float32[F, N, 3] at which robots are to stop: [N, F]; a heading of -1 stands for any."""
    yield from (Column(f"goal_{name}", _steps(ends[..., k], unit), 1, 4, unit) for k, name in enumerate("xy"))
    turn = 2 * np.pi / _TURN
    heading = _steps(np.nan_to_num(ends[..., 2]), turn) % _TURN
    yield Column("goal_heading", np.where(np.isnan(ends[..., 2]).T, -1, heading), 0, 2, turn)


def route_columns(routes: Sequence[NDArray[np.float32]], grid: GridMap) -> Iterator[Column]:
    """Yield how many points each route float32[K, 2] [m] has, then the points of all."""
    unit = position_unit(grid)
    points = np.concatenate([np.empty((0, 2), dtype=np.float32), *routes])
    yield _names("route_points", np.array([len(route) for route in routes], dtype=np.int64))
    yield from (Column(f"route_{name}", _steps(points[:, k], unit), 1, 2, unit) for k, name in enumerate("xy"))


def floor_columns(grid: GridMap) -> Iterator[Column]:
    """Yield each cell's marks (1 whole shelf, 2 pick, 4 station), its direction, and its height."""
    cells = grid.walls.astype(np.int64)
    for cell, mark in ((grid.picks, 2), (grid.stations, 4)):
        cells[tuple(cell.T)] |= mark
    yield Column("cells", cells.reshape(-1), 0, 1)
    yield Column("one_way", grid.one_way.reshape(-1).astype(np.int64), 0, 1)
    yield _scaled("height", grid.height.reshape(-1), 0)


def _steps(values: NDArray[np.floating[Any]], unit: float, moved: bool = True) -> Whole:
    """Return values as whole numbers of a unit, time last if it came first."""
    whole = np.rint(np.asarray(values, dtype=np.float64) / unit).astype(np.int64)
    return whole.T if moved else whole


def _scaled(name: str, values: NDArray[np.floating[Any]], order: int) -> Column:
    """Return signed numbers as a byte each: 127 is the largest."""
    most = float(np.abs(values).max(initial=0.0)) or 1.0
    return Column(name, _steps(values, most / _EIGHT_BIT), order, 1, most / _EIGHT_BIT)


def _names(name: str, values: NDArray[np.integer[Any]]) -> Column:
    """Return indices, -1 for none, in as few bytes as they need."""
    most = int(values.max(initial=0))
    return Column(name, values.astype(np.int64), 0, 1 if most < 128 else 2 if most < 32_768 else 4)


def _bytes(column: Column) -> bytes:
    """Return the lowest byte of all differences along the last axis, then the next ones."""
    values = column.values
    for _ in range(column.order):
        values = np.diff(values, axis=-1, prepend=0)
    planes = [(values >> 8 * k & 255).astype(np.uint8).tobytes() for k in range(column.width)]
    return b"".join(planes)
