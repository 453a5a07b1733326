"""How adapters build Simulators from keyword arguments, reset them as options say, and pack actions."""

import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig, EnvOptions
from warehouse_env.errors import ActionError, ConfigError, check_count, check_known, shown
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.plan import Planner
from warehouse_env.routes.book import RouteBook
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment

Made = TypeVar("Made")

_RESET = ("starts", "goals", "num_agents")  # options of a reset


class WorldOptions(EnvOptions, total=False):
    """Keyword arguments of every env."""

    grid: GridMap | None  # instead of the layout that the config names
    planner: Planner | str | None  # an object, or a name of PLANNERS


def build(
    kind: Callable[..., Made], config: EnvConfig | None, options: WorldOptions, num_worlds: int = 1, **parts: Any
) -> Made:
    """Build a Simulator, or what takes the same arguments, from `config` (or the defaults) with `options` put in.

    A planner's name goes into the config; `parts` go to the simulator as they are. ConfigError names an unknown
    parameter, with near matches; MapError says what is wrong with a map.
    """
    if config is not None and not isinstance(config, EnvConfig):
        raise ConfigError(f"config={shown(config)} must be of type EnvConfig")
    chosen: dict[str, Any] = {**options}
    grid, planner = chosen.pop("grid", None), chosen.pop("planner", None)
    if isinstance(planner, str):
        chosen["planner"], planner = planner, None
    return kind((config or EnvConfig()).replace(**chosen), num_worlds, grid=grid, planner=planner, **parts)


def reset(simulator: Any, seed: int | None, options: object, one: bool = False) -> Any:
    """Reset a Simulator or DeviceSimulator as options say (see `assignments_of`), and return the observation."""
    return simulator.reset(seed, assignments_of(options, [simulator.num_agents] * simulator.num_worlds, one))


def robots_of(options: object, most: int) -> int:
    """Return how many robots the options of a reset ask for, by default `most`; ConfigError for more or none."""
    count = options.get("num_agents") if isinstance(options, Mapping) else None
    robots = most if count is None else check_count("num_agents", count)
    if robots > most:
        raise ConfigError(f"num_agents={robots} is more than the {most} of this environment; make one of as many")
    return robots


def assignments_of(options: object, robots: Sequence[int], one: bool = False) -> list[Assignment] | None:
    """Return what the options of a reset assign to each world, of so many robots; None: starts and goals are drawn.

    starts and goals hold a table for each world, as `Assignment` takes it; one: of the only world, the table itself.
    num_agents: the number of robots as it is (see `robots_of`). ConfigError for everything else.
    """
    given = {} if options is None else options
    if not isinstance(given, Mapping):
        raise ConfigError(f"options={shown(options)} must be a dict of {', '.join(_RESET)}")
    check_known("option of a reset", given, _RESET)
    count = given.get("num_agents")
    if count is not None and {check_count("num_agents", count)} != set(robots):
        raise ConfigError(f"only parallel_env and aec_env change their number of robots, to {count} or any other")
    tables = [[given[name]] if one else given[name] for name in ("starts", "goals") if given.get(name) is not None]
    if not tables:
        return None
    if len(tables) < 2:
        raise ConfigError("the options starts and goals of a reset go together; give both or neither")
    if not all(isinstance(table, (Sequence, np.ndarray)) and len(table) == len(robots) for table in tables):
        raise ConfigError(f"starts and goals must be lists of a table for each of the {len(robots)} worlds")
    return [Assignment(*pair) for pair in zip(*tables, strict=True)]


def share_routes(simulators: Sequence[Simulator]) -> None:
    """Let simulators use one source of routes where floor, planner, lanes and widest body are the same."""
    books: dict[tuple[object, ...], RouteBook] = {}
    for one in simulators:
        key = one.grid.key, one.route_book.planner.key, one.config.keep_right, one.config.widest_body.wider
        one.route_book = books.setdefault(key, one.route_book)


class ActionPacker:
    """Gives the actions of one world's robots to its Simulator."""

    def __init__(self, names: Sequence[str], space: spaces.Space[Any]) -> None:
        """names: of the robots; space: of each action."""
        self._names, self._space = names, space
        self._whole: Any = np.zeros((1, len(names)), np.int64) if isinstance(space, spaces.Discrete) else None
        self._form = f"{len(names)}q"

    def step(self, simulator: Simulator, given: Sequence[Any]) -> None:
        """Step the world; ActionError names the first robot whose action the space does not hold."""
        packed = self._pack(given)
        try:
            simulator.step(packed)
        except ActionError:
            raise self._bad_action(given) from None

    def _pack(self, given: Sequence[Any]) -> NDArray[Any]:
        """Return int64[1, N], overwritten by the next call, or numbers [1, N, 2], whose values are not checked."""
        try:
            if self._whole is not None:  # struct takes whole numbers of any make, and takes half of numpy's time
                struct.pack_into(self._form, self._whole, 0, *given)
                return self._whole  # type: ignore[no-any-return]
            values = np.array([given])
        except (struct.error, TypeError, ValueError):  # ValueError: ragged
            raise self._bad_action(given) from None
        if values.ndim != 3 or values.dtype.kind not in "fiu":
            raise self._bad_action(given)
        return values

    def _bad_action(self, given: Sequence[Any]) -> ActionError:
        """Return (not raise) the error for the first action that the space does not hold."""
        names = self._names
        for name, action in zip(names, given, strict=True):
            problem = _problem(action, self._space)
            if problem:
                return ActionError(f"action of {name}: {problem}")
        return ActionError(f"the actions of {names[0]} to {names[-1]} do not fit together in one array")


def _problem(action: Any, space: spaces.Space[Any]) -> str:
    """Return what is wrong with one action, or an empty string."""
    try:
        value = np.asarray(action)
    except ValueError:
        return f"{shown(action)} is not an array of numbers"
    if isinstance(space, spaces.Discrete):
        if value.shape != () or value.dtype.kind not in "iu":
            return f"{shown(action)} is not one whole number"
        if not 0 <= int(value) < space.n:
            return f"{shown(action)} is outside 0..{space.n - 1}"
        return ""
    if value.dtype.kind not in "fiu":
        return f"{shown(action)} is not an array of numbers"
    if value.shape != space.shape:
        return f"shape {value.shape} given, {space.shape} needed"
    if not np.isfinite(value).all():
        return f"{value.tolist()} has a value that is not finite"
    return ""
