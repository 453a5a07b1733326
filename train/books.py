"""Route caches that simulators on one floor share, so that a process plans each route once."""

from warehouse_env.config import EnvConfig
from warehouse_env.maps.fitting import load_floor
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning import make_planner
from warehouse_env.routes.book import RouteBook
from warehouse_env.simulation.simulator import Simulator

_MOST = 64  # books kept, the most recently used
_books: dict[tuple[object, ...], RouteBook] = {}


def book_of(config: EnvConfig, grid: GridMap | None = None) -> RouteBook:
    """Return this process's book of a floor, planner and lanes; grid: instead of that which the config names."""
    grid, planner = load_floor(config, grid), make_planner(config.planner)
    floor = (grid.name, grid.key, grid.picks.tobytes(), grid.stations.tobytes())
    key = (*floor, planner.key, config.keep_right, config.widest_body.wider)
    book = _books.pop(key, None) or RouteBook(
        grid, planner, keep_right=config.keep_right, wider=config.widest_body.wider
    )
    _books[key] = book
    if len(_books) > _MOST:
        del _books[next(iter(_books))]
    return book


def simulator_of(config: EnvConfig, worlds: int, grid: GridMap | None = None) -> Simulator:
    """Return a new simulator on the book of `book_of`."""
    return Simulator(config, worlds, routes=book_of(config, grid))
