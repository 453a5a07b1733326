"""GridMap: shelves, floor heights and endpoints on a grid; the only place that converts metres and cells."""

import dataclasses
import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.errors import MapError, shown
from warehouse_env.maps import discs as disc_checks
from warehouse_env.maps import moves, one_way, tables
from warehouse_env.maps.endpoints import default_endpoints, largest_region
from warehouse_env.maps.moves import MOVES as MOVES
from warehouse_env.maps.tables import frozen

Cell = tuple[int, int]

SMALLEST_CELL, LARGEST_CELL = 0.01, 1000.0  # [m]
HIGHEST = 1e4  # [m], up or down
FARTHEST = 1e8  # [m] of an origin
DISTANCE_FIELDS_KEPT = 128  # per map; 17 kB each on 46 x 46 cells


def turned(points: ArrayLike, angle: float) -> NDArray[np.float64]:
    """Return float64[..., 2], points (x, y) turned counter-clockwise about (0, 0) by an angle [rad]."""
    array = np.asarray(points, dtype=np.float64)
    x, y, cosine, sine = array[..., 0], array[..., 1], math.cos(angle), math.sin(angle)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


@dataclass(frozen=True, eq=False)
class GridMap:
    """A warehouse floor; its arrays are checked, copied and made read-only (MapError if something is wrong).

    occupied: bool[H, W], True where a shelf stands; row 0 is the north edge.
    height: float32[H, W], floor height [m]; flat if not given.
    cell_size: side of a cell [m].
    picks, stations: int64[K, 2], endpoint cells (row, col) of lifelong tasks; `default_endpoints` if not given.
    one_way: uint8[H, W], the direction of a cell as an index into one_way.ARROWS; none if not given.
    origin: (x, y) [m] of the south-west corner in the frame of the map's file (`world`).
    discs: float32[K, 3], round obstacles (x, y, radius) [m]; none if not given. Cells they reach into are occupied.
    walls: bool[H, W], the cells that are whole shelves; by default those given as occupied.
    speed: float64[H, W], speed limits of cells [m/s], inf for none; or None.
    price: float64[H, W, 8], factor of at least 1 on the length of each of MOVES, for planners; or None.
    tight: bool[H, W], floor on which robots' bodies do not fit, which planners avoid (maps/fitting.py); or None.
    pace: [m/s] of robots without limits; planners count the time lost by limits against it (`at_pace`).
    yaw: [rad], the heading of the floor's x axis in the frame of the map's file.
    """

    occupied: NDArray[np.bool_]
    height: NDArray[np.float32] = None  # type: ignore[assignment]
    cell_size: float = 1.0
    picks: NDArray[np.int64] = None  # type: ignore[assignment]
    stations: NDArray[np.int64] = None  # type: ignore[assignment]
    name: str = "unnamed"
    one_way: NDArray[np.uint8] = None  # type: ignore[assignment]
    origin: tuple[float, float] = (0.0, 0.0)
    discs: NDArray[np.floating[Any]] = None  # type: ignore[assignment]
    walls: NDArray[np.bool_] = None  # type: ignore[assignment]
    speed: NDArray[np.float64] | None = None
    price: NDArray[np.float64] | None = None
    tight: NDArray[np.bool_] | None = None
    pace: float = RobotSpec.max_speed
    yaw: float = 0.0

    def __post_init__(self) -> None:
        occupied = tables.occupied_cells(self.occupied)
        cell = tables.number(self.cell_size, "cell_size", SMALLEST_CELL, LARGEST_CELL)
        discs = disc_checks.checked(self.discs, occupied.shape, cell)
        walls, occupied = disc_checks.among(occupied, self.walls, discs, cell)
        height = np.zeros(occupied.shape)
        if self.height is not None:
            height = tables.numbers(self.height, occupied.shape, "height", -HIGHEST, HIGHEST)
        checked: dict[str, Any] = {
            "occupied": frozen(occupied), "walls": frozen(walls), "discs": frozen(discs), "cell_size": cell,
            "height": frozen(height.astype(np.float32)), "one_way": frozen(one_way.checked(self.one_way, occupied)),
            "origin": tables.point(self.origin, "origin", FARTHEST),
            "yaw": tables.number(self.yaw, "yaw", -FARTHEST, FARTHEST, "rad"),
            "pace": tables.number(self.pace, "pace", tables.SLOWEST, tables.FASTEST, "m/s"),
            "speed": tables.speed_limits(self.speed, occupied),
            "price": tables.price_factors(self.price, occupied.shape),
            "tight": tables.marks_on_floor(self.tight, occupied, "tight"),
        }  # fmt: skip
        if not isinstance(self.name, str):
            raise MapError(f"name={shown(self.name)} must be a text")
        vars(self).update(checked)
        endpoints = {"picks": self.picks, "stations": self.stations}
        if self.picks is None or self.stations is None:
            for what, cells in zip(endpoints, default_endpoints(occupied), strict=True):
                endpoints[what] = cells if endpoints[what] is None else endpoints[what]
        vars(self).update({what: frozen(self._checked_endpoints(cells, what)) for what, cells in endpoints.items()})

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the fields only; the copy is checked and read-only again, with empty caches."""
        return GridMap, tuple(getattr(self, field.name) for field in dataclasses.fields(self))

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return itself: it is immutable, and all copies share its caches."""
        return self

    def _checked_endpoints(self, cells: ArrayLike, what: str) -> NDArray[np.int64]:
        try:
            array = np.asarray(cells)
        except (TypeError, ValueError):  # rows of different lengths, or no table at all
            array = np.empty(0)
        if array.ndim != 2 or array.shape[1] != 2 or len(array) == 0 or array.dtype.kind not in "iu":
            raise MapError(f"{what} must be a list of one or more cells, each two whole numbers (row, column)")
        rows, columns = self.shape
        array = np.asarray(np.clip(array, -1, max(rows, columns)), dtype=np.int64)  # so that none wraps round
        inside = ((array >= 0) & (array < (rows, columns))).all(axis=1)
        clipped = np.clip(array, 0, (rows - 1, columns - 1))
        usable = inside & self.region[tuple(clipped.T)]
        if not usable.all():
            cell = self.check_cell(array[np.argmin(usable)], f"{what} cell")
            raise MapError(f"{what} cell {cell} cannot be reached from the largest free region; move or remove it")
        cells, counts = np.unique(array, axis=0, return_counts=True)
        if len(cells) < len(array):
            raise MapError(f"{what} names cell {tuple(cells[np.argmax(counts)].tolist())} more than once")
        return array

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.occupied.shape

    @cached_property
    def key(self) -> str:
        """Return 32 hex digits that identify the content (shelves, discs, heights, cell size, rules of lanes)."""
        parts: list[Any] = [f"{self.shape} {self.cell_size!r} ".encode(), self.occupied, self.height]
        parts += [self.one_way] if self.one_way.any() else []
        parts += [self.discs, self.walls] if len(self.discs) else []
        parts += [self.tight] if self.tight is not None else []
        parts += [f"{self.pace!r}".encode(), self.surplus] if self.surplus is not None else []
        parts += [self.speed] if self.speed is not None else []
        return hashlib.blake2b(b"".join(map(bytes, parts)), digest_size=16).hexdigest()

    @cached_property
    def region(self) -> NDArray[np.bool_]:
        """bool[H, W], the largest free region connected by eq. 26 moves, where robots drive."""
        return frozen(largest_region(~self.closed))

    @cached_property
    def closed(self) -> NDArray[np.bool_]:
        """bool[H, W], cells that planners avoid: shelves and tight floor."""
        return self.occupied if self.tight is None else frozen(self.occupied | self.tight)

    @cached_property
    def free_cells(self) -> NDArray[np.int64]:
        """int64[F, 2], the cells (row, column) of `region`, in reading order."""
        return frozen(np.argwhere(self.region))

    @cached_property
    def endpoints(self) -> tuple[list[Cell], list[Cell], list[Cell]]:
        """Return the picks, the stations, and all of them in reading order, each once; as Python numbers."""
        picks, stations = ([(int(r), int(c)) for r, c in cells] for cells in (self.picks, self.stations))
        return picks, stations, sorted({*picks, *stations})

    @cached_property
    def legal_moves(self) -> NDArray[np.bool_]:
        """bool[H, W, 8]: may a robot on this cell make MOVES[m] (eq. 26, paper 000)?

        Start and target are free and inside; a diagonal also needs both orthogonal cells free; and the move is not
        against the direction of either. Symmetric but for one-way cells and tight ones: nobody enters a tight cell, and
        a robot on one leaves over as few of them as possible.
        """
        return frozen(moves.legal_moves(self.occupied, self.one_way, self.tight))

    @cached_property
    def entries(self) -> NDArray[np.bool_]:
        """bool[H, W, 8]: may a robot come to this cell from its neighbour at MOVES[m]?

        The same as `legal_moves` but for one-way cells.
        """
        symmetric = self.tight is None and not self.one_way.any()
        return self.legal_moves if symmetric else frozen(moves.reversed_moves(self.legal_moves))

    @cached_property
    def surplus(self) -> NDArray[np.float64] | None:
        """float64[H, W, 8], cells of length that `price` and `speed` add to each move; or None."""
        return moves.surplus(self.speed, self.price, self.pace)

    def at_pace(self, pace: float) -> Self:
        """Return the map for robots of this unlimited speed [m/s]."""
        return self if self.speed is None or pace == self.pace else dataclasses.replace(self, pace=pace)

    def without(self, cell: Cell) -> Self:
        """Return the map with one more cell occupied, to plan on; it keeps a single endpoint."""
        occupied = self.occupied.copy()
        occupied[cell] = True
        free = ~(occupied | self.closed)
        arrows, one = np.where(occupied, 0, self.one_way), np.argwhere(largest_region(free))[:1]
        if not len(one):
            raise MapError(f"without cell {cell} map {shown(self.name)} has no floor left")
        return dataclasses.replace(self, occupied=occupied, one_way=arrows, picks=one, stations=one)

    def centre(self, cells: ArrayLike) -> NDArray[np.float64]:
        """Return float64[..., 2], the centres (x east, y north) [m] of cells (row, col) int[..., 2]."""
        array = np.asarray(cells)
        x = (array[..., 1] + 0.5) * self.cell_size
        y = (self.shape[0] - 1 - array[..., 0] + 0.5) * self.cell_size
        return np.stack([x, y], axis=-1)

    def cell(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return int64[..., 2], the cells (row, col) that hold points (x, y) [m]; off the floor they lie outside."""
        array = np.asarray(points, dtype=np.float64)
        column = np.floor(array[..., 0] / self.cell_size)
        row = self.shape[0] - 1 - np.floor(array[..., 1] / self.cell_size)
        return np.stack([row, column], axis=-1).astype(np.int64)

    def marked(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return bool[H, W]: which cells are among some (row, column) int64[K, 2]."""
        found = np.zeros(self.shape, np.bool_)
        found[tuple(cells.T)] = True
        return found

    def nearest_cell(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return int64[..., 2], the cells of the floor (row, col) that hold points (x, y) [m], or are nearest to them.

        For poses that may lie off the floor: on its rim, believed, or measured.
        """
        return self.cell(points).clip(0, np.array(self.shape) - 1)

    def standing(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return int64[..., 2], the cells from which robots at points (x, y) [m] plan: those that hold them.

        A robot may stand in a cell that a disc closes, or believe that it is in a shelf or off the floor: it plans from
        the nearest cell of `free_cells`.
        """
        from warehouse_env.maps.standing import standing_cells

        array = np.asarray(points, dtype=np.float64)[..., :2]
        cells = np.empty(array.shape, dtype=np.int64)
        flat = np.ascontiguousarray(array).reshape(-1, 2)
        standing_cells(flat, self.occupied, self.free_cells, float(self.cell_size), cells.reshape(-1, 2))
        return cells

    def world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return float64[..., 2], points (x, y) [m] of the simulation in the frame of the map's file."""
        return turned(points, self.yaw) + self.origin

    def local(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return float64[..., 2], points (x, y) [m] in the frame of the map's file as the simulation has them."""
        return turned(np.asarray(points, dtype=np.float64)[..., :2] - self.origin, -self.yaw)

    @cached_property
    def _distances(self) -> Callable[[Cell], NDArray[np.float64]]:
        """The computed fields of `distance_to` by goal."""
        from warehouse_env.maps.distance import distance_field

        return lru_cache(DISTANCE_FIELDS_KEPT)(lambda goal: frozen(distance_field(self.entries, MOVES, *goal)))

    def distance_to(self, goal: Cell) -> NDArray[np.float64]:
        """Return float64[H, W], the exact octile cost-to-go [cells] to `goal` by eq. 26 moves; inf where unreachable.

        Read-only, and kept for the last `DISTANCE_FIELDS_KEPT` goals. MapError if the goal is outside or on a shelf.
        """
        return self._distances(self.check_cell(goal, "goal"))

    def return_region(self, cell: Cell) -> NDArray[np.bool_]:
        """Return bool[H, W]: the cells that can be reached from a cell and from which it can be reached again."""
        from warehouse_env.maps.distance import distance_field

        there = distance_field(self.legal_moves, MOVES, cell[0], cell[1])
        return np.asarray(np.isfinite(there) & np.isfinite(self.distance_to(cell)))

    def check_cell(self, cell: ArrayLike, what: str) -> Cell:
        """Return `cell` as two Python ints; MapError, beginning with `what`, if it is outside or on a shelf."""
        row, column = tables.whole_cell(cell, what)
        rows, columns = self.shape
        if not (0 <= row < rows and 0 <= column < columns):
            given = shown((row, column))
            raise MapError(
                f"{what} {given} is outside map {shown(self.name)}: rows 0..{rows - 1}, columns 0..{columns - 1}"
            )
        if self.occupied[row, column]:
            raise MapError(f"{what} ({row}, {column}) is on a shelf of map {shown(self.name)}; choose a free cell")
        return row, column

    def text(self) -> list[str]:
        """Return one line a row: `#` shelf, `p` pick, `s` station, `~` raised or sunken floor, `.` other floor.

        One-way cells show their arrow instead.
        """
        drawing = np.where(self.occupied, "#", np.where(self.height != 0, "~", "."))
        drawing[tuple(self.picks.T)] = "p"
        drawing[tuple(self.stations.T)] = "s"
        arrows = np.array(list(one_way.ARROWS))[self.one_way]
        return ["".join(row) for row in np.where(self.one_way > 0, arrows, drawing)]
