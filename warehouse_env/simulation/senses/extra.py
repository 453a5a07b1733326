"""The slice `extra` of the observation, which a user's own sensor fills for many worlds at a time."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env import plugins
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, shown
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.observation import ObservationLayout, make_sensor
from warehouse_env.simulation.state import State


class SensorView(NamedTuple):
    """What an extra sensor may use: W worlds of N robots as they stand. Do not write to its arrays, nor keep them."""

    config: EnvConfig
    grid: GridMap
    state: State  # arrays [W, N, ...], of true poses
    routes: NDArray[np.float32]  # [W, N, R, 2] [m], of which state.route_points are valid
    persons: NDArray[Any]  # PERSON[W, P], with the fields x and y [m]
    steps: NDArray[np.int64]  # [W], env steps since the reset
    keys: NDArray[np.uint64]  # [W, 3], of each episode: noise drawn from (key, step) is the same in any batch


class ExtraSensor:
    """A user's sensor, whose numbers are checked; it keeps nothing from one observation to the next."""

    def __init__(self, config: EnvConfig, layout: ObservationLayout) -> None:
        """Make the sensor that the config names; ConfigError unless its bounds are two numbers, or `size` each."""
        self._name, self._sensor = str(config.sensor.extra), make_sensor(config)
        self._part = layout.slices["extra"]
        self.low, self.high = np.full((2, layout.size), [[-np.inf], [np.inf]], np.float32)
        with plugins.running(self._name):
            self.low[self._part], self.high[self._part] = getattr(self._sensor, "bounds", (-np.inf, np.inf))

    def write(self, simulator: Any, worlds: list[int] | slice) -> None:
        """Write the slice of some worlds of a Simulator; ConfigError for what is no array of numbers within bounds."""
        state = State(*(part[worlds] for part in simulator.state))
        view = SensorView(
            simulator.config, simulator.grid, state, simulator.routes[worlds], simulator.people.persons[worlds],
            simulator.steps[worlds], simulator.draws.keys[worlds],
        )  # fmt: skip
        with plugins.running(self._name):
            seen = self._sensor.observe(view)
        wanted = (*view.state.speed.shape, self._part.stop - self._part.start)
        if not isinstance(seen, np.ndarray) or seen.shape != wanted or seen.dtype.kind not in "fiub":
            got = f"{seen.dtype}{list(seen.shape)}" if isinstance(seen, np.ndarray) else shown(seen)
            raise ConfigError(f"{self._name} must observe an array of numbers {list(wanted)}, not {got}")
        written = seen.astype(np.float32)
        within = np.isfinite(written) & (written >= self.low[self._part]) & (written <= self.high[self._part])
        if not within.all():
            raise ConfigError(f"{self._name} observes {written[~within][0]}, which is not finite or beyond its bounds")
        simulator.observation[worlds, :, self._part] = written
